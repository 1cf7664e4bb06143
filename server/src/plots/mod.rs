//! Plots of a job's result and of a study's table, as SVG for print.
//!
//! [`job`] and [`study`] define what is shown, as a [`chart::Chart`]; [`draw`] draws it. The service and the command
//! line both use these modules, so that the same result gives the same bytes. The figures are computed by
//! `packstone_engine::analysis`.

pub(crate) mod axis;
pub(crate) mod chart;
pub(crate) mod draw;
pub(crate) mod job;
mod names;
mod quality;
mod representative;
mod shapes;
pub(crate) mod study;
mod style;
mod text;
pub(crate) mod theme;

use std::io;

/// Why a plot is not drawn.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PlotError {
    /// The result or the study has nothing that the plot could show; the text states which ones have.
    #[error("{0}")]
    NotAvailable(String),
    /// The result cannot be read, or the drawing cannot be laid out.
    #[error(transparent)]
    Failed(#[from] io::Error),
}

/// Media type of a plot.
pub(crate) const MEDIA_TYPE: &str = "image/svg+xml";

/// Declares the kinds of a plot with their names.
macro_rules! kinds {
    ($(#[$meta:meta])* $type:ident { $($(#[$doc:meta])* $kind:ident $name:literal,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $type { $($(#[$doc])* $kind,)* }

        impl $type {
            /// All kinds, in the order of the documentation.
            pub(crate) const ALL: &[Self] = &[$(Self::$kind,)*];

            /// Name in addresses, and in the name of a file.
            pub(crate) fn name(self) -> &'static str {
                match self { $(Self::$kind => $name,)* }
            }
        }
    };
}
pub(crate) use kinds;
