//! Which format of a result or a table a request wants: `?format=` first, then `Accept` (RFC 9110, 12.5.1).

use axum::http::{HeaderMap, header};
use packstone_engine::export::ExportType;

use crate::formats::ResultFormat;
use crate::http::params::values::Named;
use crate::http::params::{Choice, choices, names, shown};
use crate::problem::{Kind, KnownFormat, Problem};

choices! {
    ResultFormat,
}

choices! {
    /// A format of tables.
    pub(crate) enum TableFormat {
        /// An object with `columns` and `rows`.
        Json "json",
        /// Comma-separated values under one header line.
        Csv "csv",
    }
}

impl TableFormat {
    fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv",
        }
    }
}

/// The format of a result, or the problem that none fits.
pub(crate) fn format(
    asked: Option<&Named<ResultFormat>>,
    headers: &HeaderMap,
) -> Result<ResultFormat, Problem> {
    negotiated(asked, headers, ResultFormat::media_type).map_err(|mut problem| {
        if let Some(Named::Unknown(name)) = asked
            && let Some(kind) = ExportType::ALL.iter().find(|kind| kind.formats().contains(&name.as_str()))
        {
            let hint =
                format!("; {name} is a format of exports: GET .../exports/{}?format={name}", kind.name());
            problem.detail.push_str(&hint);
        }
        problem
    })
}

/// The format of a table, or the problem that none fits.
pub(crate) fn table_format(
    asked: Option<&Named<TableFormat>>,
    headers: &HeaderMap,
) -> Result<TableFormat, Problem> {
    negotiated(asked, headers, TableFormat::media_type)
}

/// The one that is wanted, or the problem that there is none.
fn negotiated<F: Choice>(
    asked: Option<&Named<F>>,
    headers: &HeaderMap,
    media_type: fn(F) -> &'static str,
) -> Result<F, Problem> {
    let refusal = match asked {
        Some(Named::Known(format)) => return Ok(*format),
        Some(Named::Unknown(name)) => format!("the format {} is unknown", shown(name)),
        None => {
            let accept: Vec<&str> =
                headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
            let accept = if accept.is_empty() { "*/*".to_owned() } else { accept.join(",") };
            match best(&accept, F::all(), media_type) {
                Some(format) => return Ok(format),
                None => format!("Accept asks for {}", shown(&accept)),
            }
        }
    };
    let formats = F::all()
        .iter()
        .map(|format| KnownFormat { format: format.name(), media_type: media_type(*format) })
        .collect();
    Err(Problem::new(Kind::NotAcceptable, format!("{refusal}: must be one of {}", names::<F>()))
        .with(|members| members.formats = Some(formats)))
}

/// The format of highest quality; among equals the first.
fn best<F: Copy>(accept: &str, known: &[F], media_type: fn(F) -> &'static str) -> Option<F> {
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
    for format in known {
        let q = quality(media_type(*format));
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
    use packstone_engine::export::tables::Format;

    use super::*;
    use crate::http::params::values::Value;

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
            let format = format.map(ResultFormat::Table);
            assert_eq!(best(accept, &ResultFormat::ALL, ResultFormat::media_type), format, "{accept}");
        }
    }

    #[test]
    fn the_query_wins_and_the_list_comes_with_the_refusal() {
        let mut headers = HeaderMap::new();
        assert_eq!(format(None, &headers).unwrap(), ResultFormat::Table(Format::Json));
        headers.insert(header::ACCEPT, "text/csv".parse().unwrap());
        assert_eq!(format(None, &headers).unwrap(), ResultFormat::Table(Format::Csv));
        let named = |name: &str| <Named<ResultFormat> as Value>::read(name).unwrap();
        assert_eq!(format(Some(&named("npy")), &headers).unwrap(), ResultFormat::Table(Format::Npy));
        let problem = format(Some(&named("xlsx")), &headers).unwrap_err();
        assert_eq!(problem.status, 406);
        assert_eq!(
            problem.detail,
            "the format \"xlsx\" is unknown: must be one of json, csv, vtk, vtp, npy, view, html"
        );
        assert_eq!(problem.members.formats.unwrap()[1].media_type, "text/csv");
        let problem = format(Some(&named("vti")), &headers).unwrap_err();
        assert!(problem.detail.ends_with("GET .../exports/voxels?format=vti"), "{}", problem.detail);
    }
}
