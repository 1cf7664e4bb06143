//! Values that are one of a few names.

#[cfg(test)]
use utoipa::openapi::schema::{Object, ObjectBuilder, Type};

use crate::http::params::shown;
use crate::http::params::values::Value;

/// A value that is one of a few, each with a name. The names are the schema and the reading in one.
pub(crate) trait Choice: Copy + 'static {
    /// All of them, in the order of the document.
    fn all() -> &'static [Self];

    /// The name of this one.
    fn name(self) -> &'static str;
}

/// The names of all values, for messages.
pub(crate) fn names<T: Choice>() -> String {
    T::all().iter().map(|choice| choice.name()).collect::<Vec<_>>().join(", ")
}

impl<T: Choice> Value for T {
    #[cfg(test)]
    fn schema() -> Object {
        let names: Vec<&str> = T::all().iter().map(|choice| choice.name()).collect();
        ObjectBuilder::new().schema_type(Type::String).enum_values(Some(names)).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        let found = T::all().iter().copied().find(|choice| choice.name() == text);
        found.ok_or_else(|| {
            let one_of = if T::all().len() > 1 { "one of " } else { "" };
            format!("{} is unknown: must be {one_of}{}", shown(text), names::<T>())
        })
    }

    fn write(&self) -> String {
        self.name().to_owned()
    }
}

/// Declares the values that a parameter may have with their names, or makes a type that has `ALL` and `name` such a
/// choice.
macro_rules! choices {
    ($($(#[$meta:meta])* $vis:vis enum $type:ident { $($(#[$doc:meta])* $choice:ident $name:literal,)+ })+) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        $vis enum $type { $($(#[$doc])* $choice,)+ }

        impl $crate::http::params::Choice for $type {
            fn all() -> &'static [Self] {
                &[$(Self::$choice,)+]
            }

            fn name(self) -> &'static str {
                match self { $(Self::$choice => $name,)+ }
            }
        }
    )+};
    ($($type:ty),+ $(,)?) => {$(
        impl $crate::http::params::Choice for $type {
            fn all() -> &'static [Self] {
                &Self::ALL
            }

            fn name(self) -> &'static str {
                self.name()
            }
        }
    )+};
}
pub(crate) use choices;
