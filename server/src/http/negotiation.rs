//! Which format of a result or a table a request wants: `?format=` first, then `Accept` (RFC 9110, 12.5.1).

use axum::http::{HeaderMap, header};
use packstone_engine::export::ExportType;
use packstone_engine::export::tables::Format;
use utoipa::ToSchema;

use crate::http::params::shown;
use crate::problem::{Kind, Problem};

/// A format of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum TableFormat {
    /// An object with `columns` and `rows`.
    Json,
    /// Comma-separated values under one header line.
    Csv,
}

impl TableFormat {
    const ALL: [Self; 2] = [Self::Json, Self::Csv];

    /// Its name in `?format=`.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
        }
    }

    fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv",
        }
    }
}

/// The format of a result, or the problem that none fits.
pub(crate) fn format(query: Option<&str>, headers: &HeaderMap) -> Result<Format, Problem> {
    let known = Format::ALL.map(|f| (f, f.name(), f.media_type()));
    negotiated(query, headers, &known).map_err(|what| {
        let known = known.iter().map(|(_, name, media_type)| (*name, *media_type));
        let mut problem = not_acceptable(&what, known);
        let export =
            ExportType::ALL.iter().find(|kind| query.is_some_and(|name| kind.formats().contains(&name)));
        if let (Some(kind), Some(name)) = (export, query) {
            let hint =
                format!("; {name} is a format of exports: GET .../exports/{}?format={name}", kind.name());
            problem.detail.push_str(&hint);
        }
        problem
    })
}

/// The format of a table, or the problem that none fits.
pub(crate) fn table_format(query: Option<&str>, headers: &HeaderMap) -> Result<TableFormat, Problem> {
    let known = TableFormat::ALL.map(|f| (f, f.name(), f.media_type()));
    negotiated(query, headers, &known)
        .map_err(|what| not_acceptable(&what, known.iter().map(|(_, name, media_type)| (*name, *media_type))))
}

/// A format with its name and media type.
type Known<F> = (F, &'static str, &'static str);

/// The one that is wanted, or in words what is.
fn negotiated<F: Copy>(query: Option<&str>, headers: &HeaderMap, known: &[Known<F>]) -> Result<F, String> {
    if let Some(name) = query {
        return known
            .iter()
            .find(|(_, known, _)| *known == name)
            .map(|(format, ..)| *format)
            .ok_or_else(|| format!("the format {} is unknown", shown(name)));
    }
    let accept: Vec<&str> =
        headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let accept = if accept.is_empty() { "*/*".to_owned() } else { accept.join(",") };
    best(&accept, known).ok_or_else(|| format!("Accept asks for {}", shown(&accept)))
}

/// Refuses `what`, and tells the names and media types that there are.
fn not_acceptable(what: &str, known: impl Iterator<Item = (&'static str, &'static str)>) -> Problem {
    let (mut formats, mut names) = (Vec::new(), Vec::new());
    for (name, media_type) in known {
        formats.push(serde_json::json!({"format": name, "media_type": media_type}));
        names.push(name);
    }
    Problem::new(Kind::NotAcceptable, format!("{what}: must be one of {}", names.join(", ")))
        .with("formats", formats.into())
}

/// The format of highest quality; among equals the first.
fn best<F: Copy>(accept: &str, known: &[Known<F>]) -> Option<F> {
    let ranges: Vec<(&str, f32)> = accept.split(',').filter_map(media_range).collect();
    let quality = |media_type: &str| {
        let top = media_type.split('/').next().unwrap_or_default();
        // The most specific range that covers the type decides, whatever its quality.
        let specific = |range: &str| {
            if range.eq_ignore_ascii_case(media_type) {
                Some(2)
            } else if range.strip_suffix("/*").is_some_and(|t| t.eq_ignore_ascii_case(top)) {
                Some(1)
            } else {
                (range == "*/*").then_some(0)
            }
        };
        ranges
            .iter()
            .filter_map(|(range, q)| specific(range).map(|level| (level, *q)))
            .max_by_key(|(level, _)| *level)
            .map_or(0.0, |(_, q)| q)
    };
    let mut best = None;
    for (format, _, media_type) in known {
        let q = quality(media_type);
        if q > 0.0 && best.is_none_or(|(_, most)| q > most) {
            best = Some((*format, q));
        }
    }
    best.map(|(format, _)| format)
}

fn media_range(item: &str) -> Option<(&str, f32)> {
    let mut parts = item.split(';');
    let range = parts.next()?.trim();
    if range.is_empty() {
        return None;
    }
    let q = parts
        .filter_map(|p| p.split_once('='))
        .find(|(name, _)| name.trim().eq_ignore_ascii_case("q"))
        .map_or(Some(1.0), |(_, q)| q.trim().parse().ok())?;
    Some((range, q))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn accept_is_weighed() {
        for (accept, format) in [
            ("*/*", Some(Format::Json)),
            ("text/csv", Some(Format::Csv)),
            ("text/*", Some(Format::Csv)),
            ("text/csv;q=0.5, application/json;q=0.4", Some(Format::Csv)),
            ("text/csv;q=0.5, */*;q=0.6", Some(Format::Json)),
            ("application/json;q=0, */*;q=0.1", Some(Format::Csv)),
            ("application/vnd.vtk.polydata+xml", Some(Format::Vtp)),
            ("application/*", Some(Format::Json)),
            ("image/png", None),
            ("application/json;q=0", None),
            ("text/csv;q=high", None),
        ] {
            let known = Format::ALL.map(|f| (f, f.name(), f.media_type()));
            assert_eq!(best(accept, &known), format, "{accept}");
        }
    }

    #[test]
    fn the_query_wins_and_the_list_comes_with_the_refusal() {
        let mut headers = HeaderMap::new();
        assert_eq!(format(None, &headers).unwrap(), Format::Json);
        headers.insert(header::ACCEPT, "text/csv".parse().unwrap());
        assert_eq!(format(None, &headers).unwrap(), Format::Csv);
        assert_eq!(format(Some("npy"), &headers).unwrap(), Format::Npy);
        let problem = format(Some("xlsx"), &headers).unwrap_err();
        assert_eq!(problem.status, 406);
        assert_eq!(problem.detail, "the format \"xlsx\" is unknown: must be one of json, csv, vtk, vtp, npy");
        assert_eq!(problem.document()["formats"][1]["media_type"], "text/csv");
        let problem = format(Some("vti"), &headers).unwrap_err();
        assert!(problem.detail.ends_with("GET .../exports/voxels?format=vti"), "{}", problem.detail);
    }
}
