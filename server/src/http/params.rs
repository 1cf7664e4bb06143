//! Reading paths and queries strictly: what a route does not know it refuses, by name.

use std::convert::Infallible;

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;

use packstone_engine::FieldError;
use packstone_engine::request::decode::MAX_FAULTS;

use crate::ids::{JobId, StudyId};
use crate::problem::{Fault, Problem};

/// The job that a path names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JobPath(pub(crate) JobId);

impl<S: Send + Sync> FromRequestParts<S> for JobPath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        match Path::<String>::from_request_parts(parts, state).await {
            Ok(Path(id)) => JobId::parse(&id).map(Self).ok_or_else(|| Problem::no_job(&id)),
            Err(_) => Err(Problem::no_job(parts.uri.path())),
        }
    }
}

/// The study that a path names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StudyPath(pub(crate) StudyId);

impl<S: Send + Sync> FromRequestParts<S> for StudyPath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        match Path::<String>::from_request_parts(parts, state).await {
            Ok(Path(id)) => StudyId::parse(&id).map(Self).ok_or_else(|| Problem::no_study(&id)),
            Err(_) => Err(Problem::no_study(parts.uri.path())),
        }
    }
}

/// The query of a request. Ask for every parameter that the route knows, then [`finish`](Self::finish).
#[derive(Debug, Default)]
pub(crate) struct Query {
    pairs: Vec<(String, String)>,
    known: Vec<&'static str>,
    faults: Vec<Fault>,
}

impl<S: Send + Sync> FromRequestParts<S> for Query {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self::parse(parts.uri.query().unwrap_or_default()))
    }
}

impl Query {
    fn parse(query: &str) -> Self {
        Self { pairs: form_urlencoded::parse(query.as_bytes()).into_owned().collect(), ..Self::default() }
    }

    /// Every value of a parameter that may be repeated.
    pub(crate) fn many(&mut self, name: &'static str) -> Vec<String> {
        self.known.push(name);
        self.pairs.iter().filter(|(n, _)| n == name).map(|(_, v)| v.clone()).collect()
    }

    /// All parameters that were not asked for so far: what they may be is for others to say.
    pub(crate) fn rest(&mut self) -> Vec<(String, String)> {
        let known = &self.known;
        let (known, rest) =
            std::mem::take(&mut self.pairs).into_iter().partition(|(name, _)| known.contains(&name.as_str()));
        self.pairs = known;
        rest
    }

    /// The value of a parameter that may not be repeated.
    pub(crate) fn one(&mut self, name: &'static str) -> Option<String> {
        let mut values = self.many(name);
        if values.len() > 1 {
            self.fault(name, format!("is given {} times: must be given once", values.len()));
            return None;
        }
        values.pop()
    }

    /// A whole number in `min..=max`.
    pub(crate) fn integer(&mut self, name: &'static str, min: i64, max: i64) -> Option<i64> {
        let text = self.one(name)?;
        match text.parse() {
            Ok(number) if (min..=max).contains(&number) => Some(number),
            _ => {
                let shown = shown(&text);
                self.fault(
                    name,
                    format!("{shown} is out of range: must be a whole number from {min} to {max}"),
                );
                None
            }
        }
    }

    /// `true` or `false`, where it is there.
    pub(crate) fn optional_flag(&mut self, name: &'static str) -> Option<bool> {
        match self.one(name)?.as_str() {
            "false" => Some(false),
            "true" => Some(true),
            other => {
                let shown = shown(other);
                self.fault(name, format!("{shown} is unknown: must be true or false"));
                None
            }
        }
    }

    /// Notes a fault in a parameter.
    pub(crate) fn fault(&mut self, name: &str, detail: impl Into<String>) {
        self.faults.push(Fault::parameter(name, detail));
    }

    /// Refuses the request where there were faults or parameters that nobody asked for.
    pub(crate) fn finish(mut self) -> Result<(), Problem> {
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
        if self.faults.is_empty() { Ok(()) } else { Err(Problem::parameters(self.faults)) }
    }
}

/// A value as messages show it.
pub(crate) fn shown(text: &str) -> String {
    let mut short: String = text.chars().take(40).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    format!("{short:?}")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_of_a_query_is_named() {
        let mut query = Query::parse("limit=0&state=a&state=b&log_x=maybe&colour=red");
        assert_eq!(query.integer("limit", 1, 500), None);
        assert_eq!(query.one("state"), None);
        assert_eq!(query.optional_flag("log_x"), None);
        let faults = query.finish().unwrap_err().errors;
        let seen: Vec<String> =
            faults.iter().map(|f| format!("{}: {}", f.parameter.as_deref().unwrap(), f.detail)).collect();
        assert_eq!(
            seen,
            [
                "limit: \"0\" is out of range: must be a whole number from 1 to 500",
                "state: is given 2 times: must be given once",
                "log_x: \"maybe\" is unknown: must be true or false",
                "colour: unknown parameter: this route has limit, state, log_x",
            ]
        );
    }

    #[test]
    fn percent_encoding_is_undone() {
        let mut query = Query::parse("label=a%3Ab+c&label=d%26");
        assert_eq!(query.many("label"), ["a:b c", "d&"]);
        query.finish().unwrap();
    }
}
