//! Plots of a study's table, as SVG.
//!
//! A plot is a pure function of the study's state, the request and this build's way of drawing, and its tag names them.

use std::collections::BTreeMap;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
#[cfg(test)]
use utoipa::openapi::schema::{Object, ObjectBuilder, Type};

use crate::http::app::App;
use crate::http::conditional;
use crate::http::drawing::{PlotOptions, not_drawn, not_modified, not_ready, svg, turn};
use crate::http::files::FileName;
use crate::http::params::values::Value;
use crate::http::params::{PlotPath, Query, parameters};
use crate::http::problems::refused;
use crate::http::results::blocking;
use crate::jobs::store::StoreError;
use crate::plots::draw;
use crate::plots::study::{self as study_plots, RunCurve, StudyOptions, StudyPlot};
use crate::plots::theme::themed;
use crate::problem::{Fault, Problem};

parameters! {
    /// What a plot of a study shows, and how.
    #[derive(Debug)]
    pub(crate) struct StudyPlotParameters {
        /// The abscissa: a column of the table that has numbers only, `grains`, or `volume_fraction_effective`. When
        /// absent the first such pointer, or `grains` where there is none and for `volume_fraction` and `event_time`;
        /// for properties the volume fraction, if it varies. `curve` and `representative_volume` have their own.
        x: Option<Abscissa>,
        /// Whether the abscissa is logarithmic; decided by its values when absent.
        log_x: Option<bool>,
        ..drawing: PlotOptions,
    }
}

/// The abscissa of a plot by its name, which the table of the study decides on.
#[derive(Debug)]
pub(crate) struct Abscissa(String);

impl Value for Abscissa {
    #[cfg(test)]
    fn schema() -> Object {
        let examples = ["/mix/volume_fraction", study_plots::GRAINS].map(serde_json::Value::from);
        ObjectBuilder::new().schema_type(Type::String).examples(examples).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        Ok(Self(text.to_owned()))
    }

    fn write(&self) -> String {
        self.0.clone()
    }
}

/// Get a plot of a study
///
/// An SVG for print, 160 mm wide: a figure of the table against one of its columns, one series for each combination of
/// the other columns that vary. `success`: success rate with its 95 % interval; `time`: time of all runs per success;
/// `distance`: distance reached; `curve`: distance against packing time, for the first replicate of each point;
/// `volume_fraction`: volume fraction with the coating; `event_time`: time of the growth per event; `youngs_modulus`,
/// `expansion`, `conductivity`, `diffusivity`: an effective property, mean and standard deviation with each packing;
/// `representative_volume`: scatter of a property against the edge of the specimen. A plot for which no run has data is
/// refused with the reason: `result-not-ready` while runs are waiting, else `format-not-available`.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/studies/{id}/plots/{kind}", tag = "studies", operation_id = "get_study_plot",
    params(
        PlotPath<StudyPlot>,
        StudyPlotParameters,
        ("If-None-Match" = Option<String>, Header, description = "Tag of the plot as known"),
    ),
    responses(
        (status = 200, description = "The plot", content((String = "image/svg+xml")),
            headers(("ETag" = String, description = "Tag of the plot"))),
        (status = 304, description = "The plot is as known"),
        crate::http::problems::sets::StudyPlotProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    PlotPath { id, kind }: PlotPath<StudyPlot>,
    Query(query): Query<StudyPlotParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (heading, theme) = (query.drawing.title.get(), query.drawing.theme.0);
    let store = &app.shared.store;
    let record = store.study(id).await?.ok_or_else(|| refused(StoreError::NoStudy, id))?;
    // Read before its runs, as that of the table. The abscissa, heading and theme are part of the address.
    let etag = format!("\"{}-{}-{}\"", record.version, kind.name(), draw::REVISION);
    if conditional::none_match_fails(&headers, &etag) {
        return Ok(not_modified(&etag));
    }
    let permit = turn(&app).await?;
    let table = store.study_table(&record).await?;
    let reports = match kind {
        StudyPlot::Curve => store.study_reports(record.seq).await?,
        _ => BTreeMap::new(),
    };
    let options = StudyOptions { x: query.x.map(|x| x.0), log_x: query.log_x };
    let open = record.finished_at.is_none();
    let drawn = blocking(id, move || {
        let curves: Vec<RunCurve> =
            reports.iter().map(|(&point, report)| RunCurve::of_report(point, report)).collect();
        let chart = study_plots::chart(kind, record.name.as_deref(), &table, &curves, &options);
        let drawn = chart.map(|chart| draw::svg(&chart, heading).map(|drawn| themed(drawn, theme)));
        drop(permit);
        match drawn {
            Ok(Ok(drawn)) => Ok(Ok(drawn)),
            Ok(Err(error)) => {
                not_drawn(error).map(|problem| Err(if open { not_ready(problem) } else { problem }))
            }
            Err(fault) => Ok(Err(Problem::parameters(vec![Fault::parameter("x", fault.to_string())]))),
        }
    })
    .await??;
    Ok(svg(drawn, &etag, &FileName::plain(format!("{id}.{}.svg", kind.name()))))
}
