//! Which format of a result a request wants: `?format=` first, then `Accept` (RFC 9110, 12.5.1).

use axum::http::{HeaderMap, header};
use packstone_engine::format::Format;

use super::params::shown;
use crate::problem::{Kind, Problem};

/// The format, or the problem that none fits.
pub(super) fn format(query: Option<&str>, headers: &HeaderMap) -> Result<Format, Problem> {
    if let Some(name) = query {
        return Format::from_name(name)
            .ok_or_else(|| not_acceptable(&format!("the format {} is unknown", shown(name))));
    }
    let accept: Vec<&str> =
        headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    if accept.is_empty() {
        return Ok(Format::Json);
    }
    let accept = accept.join(",");
    best(&accept).ok_or_else(|| not_acceptable(&format!("Accept asks for {}", shown(&accept))))
}

fn not_acceptable(what: &str) -> Problem {
    let formats: Vec<_> = Format::ALL
        .into_iter()
        .map(|f| serde_json::json!({"format": f.name(), "media_type": f.media_type()}))
        .collect();
    let names: Vec<_> = Format::ALL.into_iter().map(Format::name).collect();
    Problem::new(Kind::NotAcceptable, format!("{what}: must be one of {}", names.join(", ")))
        .with("formats", formats.into())
}

/// The format of highest quality; among equals the first of [`Format::ALL`].
fn best(accept: &str) -> Option<Format> {
    let ranges: Vec<(&str, f32)> = accept.split(',').filter_map(media_range).collect();
    let quality = |format: Format| {
        let media_type = format.media_type();
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
    for format in Format::ALL {
        let q = quality(format);
        if q > 0.0 && best.is_none_or(|(_, most)| q > most) {
            best = Some((format, q));
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
            assert_eq!(best(accept), format, "{accept}");
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
    }
}
