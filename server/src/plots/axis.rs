//! Axes: their limits, the positions of their ticks, and the text of the ticks.
//!
//! The ticks of plotters are made for screens. These are made for print: round steps, powers of ten written as
//! powers, no label twice.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// Most steps between the ticks of a linear axis.
const MOST_STEPS: f64 = 8.0;
/// Larger values are not shown, so that what is computed from them does not overflow.
const LARGEST: f64 = 1.0e290;
/// Margin beyond the extreme values, as a fraction of the axis.
const MARGIN: f64 = 0.03;

/// An axis as requested.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Axis {
    /// Quantity with its unit.
    pub(crate) label: String,
    pub(crate) scale: Scale,
    pub(crate) extent: Extent,
    /// Ticks at these values instead of round ones, where they lie within the limits.
    pub(crate) ticks: Vec<f64>,
}

/// Scale of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    Linear,
    /// Logarithmic; values that are not positive are not shown.
    Log,
}

/// Limits of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Extent {
    /// The limits of the data.
    Data,
    /// The limits of the data and 0.
    FromZero,
    /// These limits.
    Fixed(f64, f64),
}

impl Axis {
    /// A linear axis as long as its data.
    pub(crate) fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear, extent: Extent::Data, ticks: Vec::new() }
    }

    /// A logarithmic axis as long as its data.
    pub(crate) fn log(label: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::linear(label) }
    }

    /// The same from 0 on.
    pub(crate) fn with_zero(self) -> Self {
        Self { extent: Extent::FromZero, ..self }
    }

    /// The same between two values.
    pub(crate) fn between(self, low: f64, high: f64) -> Self {
        Self { extent: Extent::Fixed(low, high), ..self }
    }

    /// Whether the axis can show a value.
    pub(crate) fn accepts(&self, value: f64) -> bool {
        let smallest = if self.scale == Scale::Log { 1.0 / LARGEST } else { -LARGEST };
        (smallest..=LARGEST).contains(&value)
    }

    /// The axis for these values.
    pub(crate) fn settled(&self, values: impl Iterator<Item = f64>) -> Settled {
        let (low, high) = values
            .filter(|&v| self.accepts(v))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let (low, high) = match self.extent {
            Extent::Fixed(low, high) => (low, high),
            _ if low > high => (1.0, 10.0),
            Extent::FromZero if self.scale == Scale::Linear => padded(low.min(0.0), high.max(0.0)),
            _ if self.scale == Scale::Linear => padded(low, high),
            _ => {
                let (low, high) = padded_log(low.log10(), high.log10());
                (10_f64.powf(low), 10_f64.powf(high))
            }
        };
        let mut settled = Settled { scale: self.scale, low, high, major: Vec::new(), minor: Vec::new() };
        match self.scale {
            _ if !self.ticks.is_empty() => {
                let inside = |v: &f64| self.accepts(*v) && *v >= low && *v <= high;
                let ticks = self.ticks.iter().copied().filter(inside);
                settled.major = ticks.map(|v| Tick { value: v, text: plain(v, None) }).collect();
            }
            Scale::Linear => settled.major = linear_ticks(low, high),
            Scale::Log => (settled.major, settled.minor) = log_ticks(low, high),
        }
        settled
    }
}

/// An axis with its ends and its ticks.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Settled {
    scale: Scale,
    low: f64,
    high: f64,
    /// Ticks with a label.
    pub(crate) major: Vec<Tick>,
    /// Lines of the grid without one.
    minor: Vec<f64>,
}

/// A tick.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tick {
    pub(crate) value: f64,
    pub(crate) text: String,
}

impl Settled {
    /// Where a value lies between the ends, from 0 to 1, or a little beyond.
    pub(crate) fn share(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => (value.ln() - self.low.ln()) / (self.high.ln() - self.low.ln()),
        }
    }
}

impl Ranged for Settled {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = self.share(*value).clamp(0.0, 1.0);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<H: KeyPointHint>(&self, hint: H) -> Vec<f64> {
        if hint.weight().allow_light_points() {
            self.minor.clone()
        } else {
            self.major.iter().map(|tick| tick.value).collect()
        }
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Settled {
    fn format_ext(&self, value: &f64) -> String {
        self.major.iter().find(|tick| tick.value == *value).map(|tick| tick.text.clone()).unwrap_or_default()
    }
}

/// The ends of a linear axis around values, which stay off its edges but for 0.
fn padded(low: f64, high: f64) -> (f64, f64) {
    if low == high {
        // One value only: a tenth to either side shows its size, and 0 a unit.
        let half = if low == 0.0 { 1.0 } else { low.abs() / 10.0 };
        return (low - half, high + half);
    }
    let margin = MARGIN * (high - low);
    let low = if low == 0.0 { 0.0 } else { low - margin };
    let high = if high == 0.0 { 0.0 } else { high + margin };
    (low, high)
}

/// The same in powers of ten.
fn padded_log(low: f64, high: f64) -> (f64, f64) {
    if high - low < 0.05 {
        return (low - 0.3, high + 0.3);
    }
    let margin = MARGIN * (high - low);
    (low - margin, high + margin)
}

fn linear_ticks(low: f64, high: f64) -> Vec<Tick> {
    let raw = (high - low) / MOST_STEPS;
    let power = 10_f64.powf(raw.log10().floor());
    let factor = [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().find(|f| f * power >= raw * (1.0 - 1.0e-9));
    let step = factor.unwrap_or(10.0) * power;
    let decimals = decimals_of(step);
    let slack = 1.0e-9 * step;
    let (first, last) = (((low - slack) / step).ceil() as i64, ((high + slack) / step).floor() as i64);
    (first..=last)
        .map(|i| {
            // A quotient of whole numbers where it can be: 3 * 0.1 is not 0.3.
            let value = if step < 1.0 { i as f64 / (1.0 / step) } else { i as f64 * step };
            Tick { value, text: plain(value, Some(decimals)) }
        })
        .collect()
}

/// Ticks at powers of ten, and between them where there are few; grid lines at whole multiples.
fn log_ticks(low: f64, high: f64) -> (Vec<Tick>, Vec<f64>) {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let inside = |v: &f64| *v >= low * (1.0 - 1.0e-9) && *v <= high * (1.0 + 1.0e-9);
    let multiples = |of: &[u8]| -> Vec<f64> {
        let of = of.to_vec();
        (first..=last).flat_map(|p| of.iter().map(move |&m| power_of_ten(m, p)).collect::<Vec<_>>()).collect()
    };
    let decades = high.log10() - low.log10();
    if decades < 0.7 {
        // Less than a factor of five: round steps read better than the few multiples in it.
        let ticks = linear_ticks(low, high).into_iter().filter(|tick| inside(&tick.value)).collect();
        return (ticks, Vec::new());
    }
    let labelled: Vec<f64> = if decades < 3.2 {
        multiples(&[1, 2, 5])
    } else {
        let every = (decades / MOST_STEPS).ceil() as usize;
        multiples(&[1]).into_iter().step_by(every.max(1)).collect()
    };
    let minor = if decades < 8.0 { multiples(&[1, 2, 3, 4, 5, 6, 7, 8, 9]) } else { Vec::new() };
    let ticks =
        labelled.into_iter().filter(inside).map(|value| Tick { value, text: log_text(value) }).collect();
    (ticks, minor.into_iter().filter(inside).collect())
}

/// `multiple` times ten to the `power`, rounded once.
fn power_of_ten(multiple: u8, power: i32) -> f64 {
    let multiple = f64::from(multiple);
    if power < 0 { multiple / 10_f64.powi(-power) } else { multiple * 10_f64.powi(power) }
}

/// Decimals that a multiple of `step` needs.
fn decimals_of(step: f64) -> usize {
    (0..12)
        .find(|&n| {
            let scaled = step * 10_f64.powi(n as i32);
            (scaled - scaled.round()).abs() < 1.0e-6 * scaled
        })
        .unwrap_or(12)
}

/// A number as people write it: with so many decimals, or as many as it needs; thousands apart.
pub(crate) fn plain(value: f64, decimals: Option<usize>) -> String {
    if value != 0.0 && (value.abs() >= 1.0e7 || value.abs() < 1.0e-5) {
        return scientific(value);
    }
    let text = match decimals {
        Some(decimals) => format!("{value:.decimals$}"),
        None => format!("{value}"),
    };
    let text = if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        text.trim_start_matches('-').to_owned()
    } else {
        text.replace('-', "\u{2212}")
    };
    let (whole, rest) = text.find('.').map_or((text.as_str(), ""), |dot| text.split_at(dot));
    let digits = whole.chars().filter(char::is_ascii_digit).count();
    if digits < 5 {
        return text;
    }
    let mut grouped = String::new();
    let mut left = digits;
    for c in whole.chars() {
        grouped.push(c);
        if c.is_ascii_digit() {
            left -= 1;
            if left > 0 && left % 3 == 0 {
                // A space that does not break, as ISO 80000-1 wants it; the narrow one is not in every font.
                grouped.push('\u{A0}');
            }
        }
    }
    grouped + rest
}

/// A tick of a logarithmic axis: small numbers as such, others as powers.
fn log_text(value: f64) -> String {
    if (1.0e-3..1.0e4).contains(&value) { plain(value, None) } else { scientific(value) }
}

/// `2·10⁶`.
fn scientific(value: f64) -> String {
    let text = format!("{value:e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let raised: String = exponent
        .chars()
        .map(|c| match c {
            '-' => '\u{207B}',
            '1' => '\u{B9}',
            '2' => '\u{B2}',
            '3' => '\u{B3}',
            digit => digit.to_digit(10).and_then(|d| char::from_u32(0x2070 + d)).unwrap_or(digit),
        })
        .collect();
    let mantissa = mantissa.replace('-', "\u{2212}");
    if mantissa == "1" { format!("10{raised}") } else { format!("{mantissa}\u{B7}10{raised}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis, values: &[f64]) -> Vec<String> {
        axis.settled(values.iter().copied()).major.into_iter().map(|tick| tick.text).collect()
    }

    #[test]
    fn linear_ticks_are_round_with_as_many_decimals_as_they_need() {
        assert_eq!(
            texts(&Axis::linear(""), &[0.55, 0.70]),
            ["0.56", "0.58", "0.60", "0.62", "0.64", "0.66", "0.68", "0.70"]
        );
        assert_eq!(texts(&Axis::linear("").between(0.0, 100.0), &[]), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(texts(&Axis::linear("").with_zero(), &[3.0, 4.1]), ["0", "1", "2", "3", "4"]);
        assert_eq!(texts(&Axis::linear(""), &[-2.0, 2.0]), ["\u{2212}2", "\u{2212}1", "0", "1", "2"]);
        assert_eq!(
            texts(&Axis::linear(""), &[0.0, 60_000.0]),
            ["0", "10\u{A0}000", "20\u{A0}000", "30\u{A0}000", "40\u{A0}000", "50\u{A0}000", "60\u{A0}000"]
        );
    }

    #[test]
    fn logarithmic_ticks_are_powers_of_ten_and_what_is_between_where_that_is_little() {
        assert_eq!(texts(&Axis::log(""), &[0.02, 300.0]), ["0.1", "1", "10", "100"]);
        assert_eq!(texts(&Axis::log(""), &[0.2, 30.0]), ["0.2", "0.5", "1", "2", "5", "10", "20"]);
        assert_eq!(
            texts(&Axis::log(""), &[1.0e-6, 2.0e-2]),
            ["10\u{207B}\u{2076}", "10\u{207B}\u{2075}", "10\u{207B}\u{2074}", "0.001", "0.01"]
        );
        assert_eq!(texts(&Axis::log(""), &[2.0, 3.0]).len(), 6, "a factor of less than five has round steps");
        assert_eq!(scientific(2.5e-7), "2.5\u{B7}10\u{207B}\u{2077}");
    }

    #[test]
    fn ticks_of_ones_own_are_kept_where_they_fit() {
        let axis = Axis { ticks: vec![1.0, 2.0, 31.5, 63.0], ..Axis::log("") };
        assert_eq!(texts(&axis, &[2.0, 31.5]), ["2", "31.5"]);
    }

    #[test]
    fn every_axis_has_ends_whatever_the_values() {
        for axis in [Axis::linear(""), Axis::log(""), Axis::linear("").with_zero()] {
            for values in [
                &[][..],
                &[0.0],
                &[-3.0],
                &[7.0, 7.0],
                &[f64::NAN, 5.0, f64::INFINITY],
                &[1e-280, 1e280],
                &[1e300],
            ] {
                let settled = axis.settled(values.iter().copied());
                assert!(settled.low < settled.high, "{axis:?} {values:?}");
                assert!(settled.low.is_finite() && settled.high.is_finite(), "{axis:?} {values:?}");
                assert!(settled.major.len() <= 25, "{axis:?} {values:?}: {} ticks", settled.major.len());
                for value in values.iter().filter(|v| axis.accepts(**v)) {
                    assert!((0.0..=1.0).contains(&settled.share(*value)), "{axis:?} {values:?}");
                }
            }
        }
    }
}
