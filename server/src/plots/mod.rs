//! Plots: pictures of a job's result and of a study's table, as SVG for a page of print.
//!
//! [`job`] and [`study`] say what is shown, as a [`chart::Chart`]; [`draw`] draws it. The service and the
//! command line share all of it, so that a picture is the same wherever it comes from. Nothing here knows
//! HTTP, the store, or where results lie; what is counted and measured is the engine's `analysis`.

pub(crate) mod axis;
pub(crate) mod chart;
pub(crate) mod draw;
pub(crate) mod job;
pub(crate) mod study;
mod style;
mod text;

/// Media type of a plot.
pub(crate) const MEDIA_TYPE: &str = "image/svg+xml";

/// Declares the kinds of a plot once: their names, and that they are all.
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
