//! Sets of query parameters: their declaration, their description, and reading them.

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use packstone_engine::FieldError;
use packstone_engine::request::decode::MAX_FAULTS;
#[cfg(test)]
use utoipa::openapi::path::Parameter as Described;

use crate::http::params::values::Parameter;
use crate::problem::{Fault, Problem};

/// A set of query parameters, which several routes may share.
pub(crate) trait ParameterSet: Sized {
    /// Adds what the interface document says of each.
    #[cfg(test)]
    fn describe(described: &mut Vec<Described>);

    /// Reads them all. `None` where any is faulty; the faults are noted in `query`.
    fn read(query: &mut RawQuery) -> Option<Self>;

    /// Adds the parameters that are given, as [`read`](Self::read) reads them.
    fn write(&self, pairs: &mut Vec<(String, String)>);
}

/// The parameters of a set that are given, as the address of a request has them.
pub(crate) fn pairs(set: &impl ParameterSet) -> Vec<(String, String)> {
    let mut pairs = Vec::new();
    set.write(&mut pairs);
    pairs
}

/// Declares a set of query parameters: a struct whose fields are the parameters, with their descriptions as comments.
/// Sets that it shares with others follow after `..`.
macro_rules! parameters {
    (
        $(#[$meta:meta])*
        $vis:vis struct $name:ident {
            $($(#[doc = $doc:literal])+ $field_vis:vis $field:ident: $type:ty,)*
            $(.. $set_vis:vis $set:ident: $set_type:ty,)*
        }
    ) => {
        $(#[$meta])*
        $vis struct $name {
            $($(#[doc = $doc])+ $field_vis $field: $type,)*
            $(#[doc = "Parameters that other routes have, too."] $set_vis $set: $set_type,)*
        }

        impl $crate::http::params::ParameterSet for $name {
            #[cfg(test)]
            fn describe(described: &mut Vec<utoipa::openapi::path::Parameter>) {
                $(described.push($crate::http::params::described::query_parameter::<$type>(
                    stringify!($field),
                    &[$($doc),+],
                ));)*
                $(<$set_type as $crate::http::params::ParameterSet>::describe(described);)*
            }

            fn read(query: &mut $crate::http::params::RawQuery) -> Option<Self> {
                // Each is read before the first that is faulty is left: every fault is reported.
                $(let $field = query.read::<$type>(stringify!($field));)*
                $(let $set = <$set_type as $crate::http::params::ParameterSet>::read(query);)*
                Some(Self { $($field: $field?,)* $($set: $set?,)* })
            }

            fn write(&self, pairs: &mut Vec<(String, String)>) {
                $(pairs.extend(
                    $crate::http::params::values::Parameter::write(&self.$field)
                        .into_iter()
                        .map(|text| (stringify!($field).to_owned(), text)),
                );)*
                $($crate::http::params::ParameterSet::write(&self.$set, pairs);)*
            }
        }

        #[cfg(test)]
        $crate::http::params::described::described_query!($name);
    };
}
pub(crate) use parameters;

/// The parameters of a route that has none.
#[derive(Debug)]
pub(crate) struct NoParameters;

impl ParameterSet for NoParameters {
    #[cfg(test)]
    fn describe(_: &mut Vec<Described>) {}

    fn read(_: &mut RawQuery) -> Option<Self> {
        Some(Self)
    }

    fn write(&self, _: &mut Vec<(String, String)>) {}
}

/// Reads a set of query parameters, and refuses a request whose query is anything else.
#[derive(Debug)]
pub(crate) struct Query<T>(pub(crate) T);

impl<T: ParameterSet, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        Self::parse(parts.uri.query().unwrap_or_default())
    }
}

impl<T: ParameterSet> Query<T> {
    fn parse(text: &str) -> Result<Self, Problem> {
        let mut query = RawQuery::parse(text);
        let set = T::read(&mut query);
        query.refuse_unknown();
        match set {
            Some(set) if query.faults.is_empty() => Ok(Self(set)),
            _ => Err(Problem::parameters(query.faults)),
        }
    }
}

/// A query as names and values, with what was asked of it so far.
#[derive(Debug, Default)]
pub(crate) struct RawQuery {
    pairs: Vec<(String, String)>,
    known: Vec<&'static str>,
    faults: Vec<Fault>,
}

impl RawQuery {
    fn parse(query: &str) -> Self {
        Self { pairs: form_urlencoded::parse(query.as_bytes()).into_owned().collect(), ..Self::default() }
    }

    /// Reads one parameter; `None` where it is faulty.
    pub(crate) fn read<T: Parameter>(&mut self, name: &'static str) -> Option<T> {
        self.known.push(name);
        let texts = self.pairs.iter().filter(|(n, _)| n == name).map(|(_, text)| text.clone()).collect();
        T::read(texts, &mut |detail| self.faults.push(Fault::parameter(name, detail)))
    }

    /// All parameters that were not asked for so far: what they may be is for others to say.
    pub(crate) fn rest(&mut self) -> Vec<(String, String)> {
        let known = &self.known;
        let (known, rest) =
            std::mem::take(&mut self.pairs).into_iter().partition(|(name, _)| known.contains(&name.as_str()));
        self.pairs = known;
        rest
    }

    /// Notes the parameters that nobody asked for.
    fn refuse_unknown(&mut self) {
        let known = if self.known.is_empty() {
            ": this route has none".to_owned()
        } else {
            format!(": this route has {}", self.known.join(", "))
        };
        let mut unknown = self.pairs.iter().filter(|(name, _)| !self.known.contains(&name.as_str()));
        for (i, (name, _)) in unknown.by_ref().take(MAX_FAULTS).enumerate() {
            let name: String = name.chars().take(64).collect();
            // What the route has is listed once.
            let known = if i == 0 { known.as_str() } else { "" };
            self.faults.push(Fault::parameter(&name, format!("unknown parameter{known}")));
        }
        let more = unknown.count();
        if more > 0 {
            self.faults.push(FieldError::and_more(more).into());
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::http::params::values::{Flag, Labels, WholeNumber};
    use crate::ids::StudyId;

    parameters! {
        #[derive(Debug)]
        struct Shared {
            /// Which study.
            study: Option<StudyId>,
        }
    }

    parameters! {
        #[derive(Debug)]
        struct Sample {
            /// How many,
            /// at most.
            limit: WholeNumber<1, 500, 50>,
            /// Whether the abscissa is logarithmic.
            log_x: Option<bool>,
            /// Whether it stays.
            keep: Flag<true>,
            /// A label.
            label: Labels,
            ..shared: Shared,
        }
    }

    #[test]
    fn every_fault_of_a_query_is_named() {
        let query = "limit=0&study=a&study=b&log_x=maybe&colour=red&keep=1&label=x&size=2";
        let faults = Query::<Sample>::parse(query).unwrap_err().errors;
        let seen: Vec<String> =
            faults.iter().map(|f| format!("{}: {}", f.parameter.as_deref().unwrap(), f.detail)).collect();
        assert_eq!(
            seen,
            [
                "limit: \"0\" is out of range: must be a whole number from 1 to 500",
                "log_x: \"maybe\" is unknown: must be true or false",
                "keep: \"1\" is unknown: must be true or false",
                "label: \"x\" has no key: must be key=value",
                "study: is given 2 times: must be given once",
                "colour: unknown parameter: this route has limit, log_x, keep, label, study",
                "size: unknown parameter",
            ]
        );
    }

    #[test]
    fn what_is_absent_has_the_default_that_the_document_names() {
        let Query(absent) = Query::<Sample>::parse("").unwrap();
        assert_eq!((absent.limit.get(), absent.log_x, absent.keep.get()), (50, None, true));
        assert_eq!((absent.label, absent.shared.study), (Labels::default(), None));
        let mut described = Vec::new();
        Sample::describe(&mut described);
        let described = serde_json::to_value(&described).unwrap();
        assert_eq!(
            described[0],
            json!({
                "name": "limit", "in": "query", "required": false, "description": "How many, at most.",
                "schema": {"type": "integer", "minimum": 1, "maximum": 500, "default": 50}
            })
        );
        assert_eq!(described[2]["schema"], json!({"type": "boolean", "default": true}));
        assert_eq!(
            (&described[4]["name"], &described[4]["schema"]["format"]),
            (&json!("study"), &json!("uuid"))
        );
    }

    #[test]
    fn percent_encoding_is_undone_and_what_is_written_reads_back() {
        let Query(sample) = Query::<Sample>::parse("label=a%3Ab+c=&log_x=false&label=d%26=e").unwrap();
        assert_eq!(sample.label.0, [("a:b c".to_owned(), String::new()), ("d&".to_owned(), "e".to_owned())]);
        let pairs = pairs(&sample);
        assert_eq!(
            pairs,
            [("limit", "50"), ("log_x", "false"), ("keep", "true"), ("label", "a:b c="), ("label", "d&=e")]
                .map(|(name, text)| (name.to_owned(), text.to_owned()))
        );
        let text = form_urlencoded::Serializer::new(String::new()).extend_pairs(&pairs).finish();
        assert_eq!(super::pairs(&Query::<Sample>::parse(&text).unwrap().0), pairs);
    }
}
