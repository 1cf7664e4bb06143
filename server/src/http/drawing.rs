//! What plots of jobs and of studies share: their bound on concurrent work, their answers.

use std::io;
use std::time::Duration;

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use tokio::time::timeout;

use crate::fair_places::Place;
use crate::http::app::App;
use crate::http::client;
use crate::http::files::FileName;
use crate::http::params::values::{Flag, OrDefault};
use crate::http::params::{Choice, parameters};
use crate::http::response::set;
use crate::plots::theme::Theme;
use crate::plots::{self, PlotError};
use crate::problem::{Kind, Problem};

/// How long a plot waits for another before it is refused.
const TURN: Duration = Duration::from_secs(10);

parameters! {
    /// How a plot is drawn.
    #[derive(Debug)]
    pub(crate) struct PlotOptions {
        /// Whether the title is printed above the plot.
        pub(crate) title: Flag<true>,
        /// The ground that it is made for: `light`, dark strokes on white; or `dark`, light strokes without a ground.
        pub(crate) theme: OrDefault<Theme>,
    }
}

impl Choice for Theme {
    fn all() -> &'static [Self] {
        Self::ALL
    }

    fn name(self) -> &'static str {
        self.name()
    }
}

/// The refusal of a plot that has no data, or the fault that kept it from being drawn.
pub(crate) fn not_drawn(error: PlotError) -> io::Result<Problem> {
    match error {
        PlotError::NotAvailable(reason) => Ok(Problem::new(Kind::FormatNotAvailable, reason)),
        PlotError::Failed(error) => Err(error),
    }
}

/// The refusal of a plot whose data may still come, because runs of its study are waiting.
pub(crate) fn not_ready(refusal: Problem) -> Problem {
    Problem::new(Kind::ResultNotReady, refusal.detail).with_header("retry-after", "10")
}

/// Waits to be one of the few that draw.
pub(crate) async fn turn(app: &App) -> Result<Place, Problem> {
    match timeout(TURN, app.shared.plots.wait(&client::current())).await {
        Ok(place) => Ok(place),
        Err(_) => Err(Problem::new(Kind::Busy, "as many plots are being drawn as this server draws at once")
            .with_header("retry-after", "10")),
    }
}

/// The answer to who has the plot already.
pub(crate) fn not_modified(etag: &str) -> Response {
    let mut response = StatusCode::NOT_MODIFIED.into_response();
    set(&mut response, header::ETAG, etag);
    response
}

/// The drawing as an answer.
pub(crate) fn svg(drawn: String, etag: &str, filename: &FileName) -> Response {
    let mut response = drawn.into_response();
    set(&mut response, header::ETAG, etag);
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(plots::MEDIA_TYPE));
    set(&mut response, header::CONTENT_DISPOSITION, &filename.disposition(true));
    // A browser that opens it must not run what a viewer of pictures would not.
    let policy = "default-src 'none'; sandbox";
    set(&mut response, header::CONTENT_SECURITY_POLICY, policy);
    response
}
