//! Gradings of standards: limits of what passes each sieve, as bands or single curves.
//!
//! Each row was read in its source: DIN 1045-2 in <https://github.com/chrip/CreteLab>, with the sums of
//! <https://betontechnische-daten.de/node/4872>; ASTM C33-99 (Table 2 and 6.1), IS 383:2016 (Tables 7, 9 and 10) and
//! BS 882:1992 (Tables 3 to 5, each sand with the overall limits) in the transcriptions of
//! <https://github.com/sthashixi-netwanderer/civilqntify>; AASHTO M 43, whose sizes that ASTM C33 has too stand there
//! alone, in <https://github.com/erfanamirij5-oss/TOLUE-Concrete-Compaction-Software>; EN 12620 in
//! <https://betontechnische-daten.de>, section 2.2.3; EN 196-1 in
//! <https://www.normensand.de/produkte/cen-normsand-en-196-1/>; GB/T 14685-2022 in
//! <https://github.com/QingliangHIT/Gradation>; AREMA in
//! <https://www.graniterock.com/technical_reports/arema-4-1-ballast>. `docs/mixes.md` lists what was left out for want
//! of a source.

use serde::Serialize;

use Standard::{AashtoM43, Arema, AstmC33, Bs882, Din1045, En196, En12620, Gbt14685, Is383};

use crate::request::sieves::{MOST_UNDERSIZE, next_sieve};

/// A standard that has gradings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Standard {
    /// Concrete in Germany.
    #[default]
    #[serde(rename = "DIN 1045-2")]
    Din1045,
    /// Concrete aggregates in the United States.
    #[serde(rename = "ASTM C33")]
    AstmC33,
    /// Coarse aggregates for roads and bridges in the United States.
    #[serde(rename = "AASHTO M 43")]
    AashtoM43,
    /// Aggregates for concrete in Europe.
    #[serde(rename = "EN 12620")]
    En12620,
    /// Sand for tests of cement in Europe.
    #[serde(rename = "EN 196-1")]
    En196,
    /// Aggregates for concrete in India.
    #[serde(rename = "IS 383")]
    Is383,
    /// Aggregates for concrete in the United Kingdom until 2004.
    #[serde(rename = "BS 882")]
    Bs882,
    /// Coarse aggregates for concrete in China.
    #[serde(rename = "GB/T 14685")]
    Gbt14685,
    /// Railway ballast in North America.
    #[serde(rename = "AREMA")]
    Arema,
}

impl Standard {
    /// Every standard with its name.
    pub const NAMES: [(&'static str, Self); 9] = [
        ("DIN 1045-2", Din1045),
        ("ASTM C33", AstmC33),
        ("AASHTO M 43", AashtoM43),
        ("EN 12620", En12620),
        ("EN 196-1", En196),
        ("IS 383", Is383),
        ("BS 882", Bs882),
        ("GB/T 14685", Gbt14685),
        ("AREMA", Arema),
    ];

    /// Its name in requests.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, standard)| *standard == self).map_or("", |(name, _)| name)
    }
}

/// Which curve of a band a grading is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum LimitCurve {
    /// The least that may pass each sieve: the coarsest curve.
    Lower,
    /// The mean of both limits.
    #[default]
    Middle,
    /// The most that may pass each sieve: the finest curve.
    Upper,
}

/// A grading of a standard.
#[derive(Debug, PartialEq)]
pub struct StandardGrading {
    /// The standard.
    pub standard: Standard,
    /// The name of the grading in it.
    pub name: &'static str,
    /// Sieves in mm with the least and the most that may pass, in percent, from fine to coarse. A grading that is a
    /// curve has the same number twice.
    pub limits: &'static [(f64, u8, u8)],
}

impl StandardGrading {
    /// Whether it is one curve, with no room between its limits.
    pub fn is_curve(&self) -> bool {
        self.limits.iter().all(|(_, low, high)| low == high)
    }

    /// A curve of the grading: `[sieve in mm, passing]`, from fine to coarse, from the last sieve that nothing passes
    /// to the first that all mass passes.
    ///
    /// Where up to 20 % pass the finest sieve of a band, the next sieve of its series is added, which nothing passes.
    pub fn points(&self, curve: LimitCurve) -> Vec<[f64; 2]> {
        let passing = |low: u8, high: u8| match curve {
            LimitCurve::Lower => f64::from(low) / 100.0,
            LimitCurve::Middle => (f64::from(low) + f64::from(high)) / 200.0,
            LimitCurve::Upper => f64::from(high) / 100.0,
        };
        let of_sieves = self.limits.iter().map(|&(mm, low, high)| [mm, passing(low, high)]);
        let mut points: Vec<[f64; 2]> = of_sieves.collect();
        let empty = points.iter().take_while(|point| point[1] == 0.0).count();
        points.drain(..empty.saturating_sub(1));
        if let Some(whole) = points.iter().position(|point| point[1] >= 1.0) {
            points.truncate(whole + 1);
        }
        if let [[finest, passing], [next, _], ..] = points[..]
            && passing > 0.0
            && passing <= MOST_UNDERSIZE
            && !self.is_curve()
        {
            points.insert(0, [next_sieve(next, finest), 0.0]);
        }
        points
    }
}

/// The grading of that name.
pub fn find(standard: Standard, name: &str) -> Option<&'static StandardGrading> {
    of_standard(standard).find(|grading| grading.name == name)
}

/// The gradings of a standard.
pub fn of_standard(standard: Standard) -> impl Iterator<Item = &'static StandardGrading> {
    GRADINGS.iter().filter(move |grading| grading.standard == standard)
}

const fn of(standard: Standard, name: &'static str, limits: &'static [(f64, u8, u8)]) -> StandardGrading {
    StandardGrading { standard, name, limits }
}

/// All gradings.
#[rustfmt::skip]
pub static GRADINGS: [StandardGrading; 76] = [
    of(Din1045, "A8", &[(0.25, 5, 5), (0.5, 14, 14), (1.0, 21, 21), (2.0, 36, 36), (4.0, 61, 61), (8.0, 100, 100)]),
    of(Din1045, "B8", &[(0.25, 11, 11), (0.5, 26, 26), (1.0, 42, 42), (2.0, 57, 57), (4.0, 74, 74),
        (8.0, 100, 100)]),
    of(Din1045, "C8", &[(0.25, 21, 21), (0.5, 39, 39), (1.0, 57, 57), (2.0, 71, 71), (4.0, 85, 85),
        (8.0, 100, 100)]),
    of(Din1045, "A16", &[(0.25, 3, 3), (0.5, 8, 8), (1.0, 12, 12), (2.0, 21, 21), (4.0, 36, 36), (8.0, 60, 60),
        (16.0, 100, 100)]),
    of(Din1045, "B16", &[(0.25, 8, 8), (0.5, 20, 20), (1.0, 32, 32), (2.0, 42, 42), (4.0, 56, 56), (8.0, 76, 76),
        (16.0, 100, 100)]),
    of(Din1045, "C16", &[(0.25, 18, 18), (0.5, 34, 34), (1.0, 49, 49), (2.0, 62, 62), (4.0, 74, 74), (8.0, 88, 88),
        (16.0, 100, 100)]),
    of(Din1045, "A32", &[(0.25, 2, 2), (0.5, 5, 5), (1.0, 8, 8), (2.0, 14, 14), (4.0, 23, 23), (8.0, 38, 38),
        (16.0, 62, 62), (31.5, 100, 100)]),
    of(Din1045, "B32", &[(0.25, 8, 8), (0.5, 18, 18), (1.0, 28, 28), (2.0, 37, 37), (4.0, 47, 47), (8.0, 62, 62),
        (16.0, 80, 80), (31.5, 100, 100)]),
    of(Din1045, "C32", &[(0.25, 15, 15), (0.5, 29, 29), (1.0, 42, 42), (2.0, 53, 53), (4.0, 65, 65), (8.0, 77, 77),
        (16.0, 89, 89), (31.5, 100, 100)]),
    of(AstmC33, "1", &[(19.0, 0, 5), (37.5, 0, 15), (63.0, 25, 60), (90.0, 90, 100), (100.0, 100, 100)]),
    of(AstmC33, "2", &[(19.0, 0, 5), (37.5, 0, 15), (50.0, 35, 70), (63.0, 90, 100), (75.0, 100, 100)]),
    of(AstmC33, "3", &[(12.5, 0, 5), (25.0, 0, 15), (37.5, 35, 70), (50.0, 90, 100), (63.0, 100, 100)]),
    of(AstmC33, "357", &[(4.75, 0, 5), (12.5, 10, 30), (25.0, 35, 70), (50.0, 95, 100), (63.0, 100, 100)]),
    of(AstmC33, "4", &[(9.5, 0, 5), (19.0, 0, 15), (25.0, 20, 55), (37.5, 90, 100), (50.0, 100, 100)]),
    of(AstmC33, "467", &[(4.75, 0, 5), (9.5, 10, 30), (19.0, 35, 70), (37.5, 95, 100), (50.0, 100, 100)]),
    of(AstmC33, "5", &[(9.5, 0, 5), (12.5, 0, 10), (19.0, 20, 55), (25.0, 90, 100), (37.5, 100, 100)]),
    of(AstmC33, "56", &[(4.75, 0, 5), (9.5, 0, 15), (12.5, 10, 40), (19.0, 40, 85), (25.0, 90, 100),
        (37.5, 100, 100)]),
    of(AstmC33, "57", &[(2.36, 0, 5), (4.75, 0, 10), (12.5, 25, 60), (25.0, 95, 100), (37.5, 100, 100)]),
    of(AstmC33, "6", &[(4.75, 0, 5), (9.5, 0, 15), (12.5, 20, 55), (19.0, 90, 100), (25.0, 100, 100)]),
    of(AstmC33, "67", &[(2.36, 0, 5), (4.75, 0, 10), (9.5, 20, 55), (19.0, 90, 100), (25.0, 100, 100)]),
    of(AstmC33, "7", &[(2.36, 0, 5), (4.75, 0, 15), (9.5, 40, 70), (12.5, 90, 100), (19.0, 100, 100)]),
    of(AstmC33, "8", &[(1.18, 0, 5), (2.36, 0, 10), (4.75, 10, 30), (9.5, 85, 100), (12.5, 100, 100)]),
    of(AstmC33, "89", &[(0.3, 0, 5), (1.18, 0, 10), (2.36, 5, 30), (4.75, 20, 55), (9.5, 90, 100),
        (12.5, 100, 100)]),
    of(AstmC33, "9", &[(0.3, 0, 5), (1.18, 0, 10), (2.36, 10, 40), (4.75, 85, 100), (9.5, 100, 100)]),
    of(AstmC33, "fine", &[(0.15, 0, 10), (0.3, 5, 30), (0.6, 25, 60), (1.18, 50, 85), (2.36, 80, 100),
        (4.75, 95, 100), (9.5, 100, 100)]),
    of(AashtoM43, "68", &[(1.18, 0, 5), (2.36, 0, 10), (4.75, 5, 25), (9.5, 30, 65), (19.0, 90, 100),
        (25.0, 100, 100)]),
    of(AashtoM43, "78", &[(1.18, 0, 5), (2.36, 0, 10), (4.75, 5, 25), (9.5, 40, 75), (12.5, 90, 100),
        (19.0, 100, 100)]),
    of(En12620, "2/4 GC85/20", &[(1.0, 0, 5), (2.0, 0, 20), (4.0, 85, 99), (5.6, 98, 100), (8.0, 100, 100)]),
    of(En12620, "2/5 GC85/20", &[(1.0, 0, 5), (2.0, 0, 20), (5.6, 85, 99), (8.0, 98, 100), (11.2, 100, 100)]),
    of(En12620, "2/8 GC85/20", &[(1.0, 0, 5), (2.0, 0, 20), (8.0, 85, 99), (11.2, 98, 100), (16.0, 100, 100)]),
    of(En12620, "4/8 GC85/20", &[(2.0, 0, 5), (4.0, 0, 20), (8.0, 85, 99), (11.2, 98, 100), (16.0, 100, 100)]),
    of(En12620, "5/8 GC85/20", &[(2.8, 0, 5), (5.6, 0, 20), (8.0, 85, 99), (11.2, 98, 100), (16.0, 100, 100)]),
    of(En12620, "8/11 GC85/20", &[(4.0, 0, 5), (8.0, 0, 20), (11.2, 85, 99), (16.0, 98, 100), (22.4, 100, 100)]),
    of(En12620, "8/16 GC85/20", &[(4.0, 0, 5), (8.0, 0, 20), (16.0, 85, 99), (22.4, 98, 100), (31.5, 100, 100)]),
    of(En12620, "11/16 GC85/20", &[(5.6, 0, 5), (11.2, 0, 20), (16.0, 85, 99), (22.4, 98, 100), (31.5, 100, 100)]),
    of(En12620, "16/22 GC85/20", &[(8.0, 0, 5), (16.0, 0, 20), (22.4, 85, 99), (31.5, 98, 100), (45.0, 100, 100)]),
    of(En12620, "16/32 GC85/20", &[(8.0, 0, 5), (16.0, 0, 20), (31.5, 85, 99), (45.0, 98, 100), (63.0, 100, 100)]),
    of(En12620, "22/32 GC85/20", &[(11.2, 0, 5), (22.4, 0, 20), (31.5, 85, 99), (45.0, 98, 100), (63.0, 100, 100)]),
    of(En196, "CEN standard sand", &[(0.08, 0, 2), (0.16, 8, 18), (0.5, 28, 38), (1.0, 62, 72), (1.6, 88, 98),
        (2.0, 100, 100)]),
    of(Is383, "single-sized 63 mm", &[(10.0, 0, 5), (20.0, 0, 5), (40.0, 0, 30), (63.0, 85, 100),
        (80.0, 100, 100)]),
    of(Is383, "single-sized 40 mm", &[(10.0, 0, 5), (20.0, 0, 20), (40.0, 85, 100), (63.0, 100, 100)]),
    of(Is383, "single-sized 20 mm", &[(4.75, 0, 5), (10.0, 0, 20), (20.0, 85, 100), (40.0, 100, 100)]),
    of(Is383, "single-sized 16 mm", &[(4.75, 0, 5), (10.0, 0, 30), (16.0, 85, 100), (20.0, 100, 100)]),
    of(Is383, "single-sized 12.5 mm", &[(4.75, 0, 10), (10.0, 0, 45), (12.5, 85, 100), (16.0, 100, 100)]),
    of(Is383, "single-sized 10 mm", &[(2.36, 0, 5), (4.75, 0, 20), (10.0, 85, 100), (12.5, 100, 100)]),
    of(Is383, "graded 40 mm", &[(4.75, 0, 5), (10.0, 10, 35), (20.0, 30, 70), (40.0, 90, 100), (80.0, 100, 100)]),
    of(Is383, "graded 20 mm", &[(4.75, 0, 10), (10.0, 25, 55), (20.0, 90, 100), (40.0, 100, 100)]),
    of(Is383, "graded 16 mm", &[(4.75, 0, 10), (10.0, 30, 70), (16.0, 90, 100), (20.0, 100, 100)]),
    of(Is383, "graded 12.5 mm", &[(4.75, 0, 10), (10.0, 40, 85), (12.5, 90, 100), (20.0, 100, 100)]),
    of(Is383, "zone I", &[(0.15, 0, 10), (0.3, 5, 20), (0.6, 15, 34), (1.18, 30, 70), (2.36, 60, 95),
        (4.75, 90, 100), (10.0, 100, 100)]),
    of(Is383, "zone II", &[(0.15, 0, 10), (0.3, 8, 30), (0.6, 35, 59), (1.18, 55, 90), (2.36, 75, 100),
        (4.75, 90, 100), (10.0, 100, 100)]),
    of(Is383, "zone III", &[(0.15, 0, 10), (0.3, 12, 40), (0.6, 60, 79), (1.18, 75, 100), (2.36, 85, 100),
        (4.75, 90, 100), (10.0, 100, 100)]),
    of(Is383, "zone IV", &[(0.15, 0, 15), (0.3, 15, 50), (0.6, 80, 100), (1.18, 90, 100), (2.36, 95, 100),
        (4.75, 95, 100), (10.0, 100, 100)]),
    of(Is383, "all-in 40 mm", &[(0.15, 0, 6), (0.6, 8, 30), (4.75, 25, 45), (20.0, 45, 75), (40.0, 95, 100),
        (80.0, 100, 100)]),
    of(Is383, "all-in 20 mm", &[(0.15, 0, 6), (0.6, 10, 35), (4.75, 30, 50), (20.0, 95, 100), (40.0, 100, 100)]),
    of(Bs882, "graded 40-5", &[(5.0, 0, 5), (10.0, 10, 40), (14.0, 25, 55), (20.0, 35, 70), (37.5, 90, 100),
        (50.0, 100, 100)]),
    of(Bs882, "graded 20-5", &[(5.0, 0, 10), (10.0, 30, 60), (14.0, 40, 80), (20.0, 90, 100), (37.5, 100, 100)]),
    of(Bs882, "graded 14-5", &[(5.0, 0, 10), (10.0, 50, 85), (14.0, 90, 100), (20.0, 100, 100)]),
    of(Bs882, "single-sized 40 mm", &[(10.0, 0, 5), (20.0, 0, 25), (37.5, 85, 100), (50.0, 100, 100)]),
    of(Bs882, "single-sized 20 mm", &[(5.0, 0, 5), (10.0, 0, 25), (14.0, 0, 70), (20.0, 85, 100),
        (37.5, 100, 100)]),
    of(Bs882, "single-sized 14 mm", &[(5.0, 0, 10), (10.0, 0, 50), (14.0, 85, 100), (20.0, 100, 100)]),
    of(Bs882, "single-sized 10 mm", &[(2.36, 0, 5), (5.0, 0, 25), (10.0, 85, 100), (14.0, 100, 100)]),
    of(Bs882, "single-sized 5 mm", &[(2.36, 0, 30), (5.0, 45, 100), (10.0, 100, 100)]),
    of(Bs882, "sand overall", &[(0.15, 0, 15), (0.3, 5, 70), (0.6, 15, 100), (1.18, 30, 100), (2.36, 60, 100),
        (5.0, 89, 100), (10.0, 100, 100)]),
    of(Bs882, "sand C", &[(0.15, 0, 15), (0.3, 5, 40), (0.6, 15, 54), (1.18, 30, 90), (2.36, 60, 100),
        (5.0, 89, 100), (10.0, 100, 100)]),
    of(Bs882, "sand M", &[(0.15, 0, 15), (0.3, 5, 48), (0.6, 25, 80), (1.18, 45, 100), (2.36, 65, 100),
        (5.0, 89, 100), (10.0, 100, 100)]),
    of(Bs882, "sand F", &[(0.15, 0, 15), (0.3, 5, 70), (0.6, 55, 100), (1.18, 70, 100), (2.36, 80, 100),
        (5.0, 89, 100), (10.0, 100, 100)]),
    of(Bs882, "all-in 40 mm", &[(0.15, 0, 8), (0.6, 8, 30), (5.0, 25, 50), (20.0, 45, 80), (37.5, 95, 100),
        (50.0, 100, 100)]),
    of(Bs882, "all-in 20 mm", &[(0.15, 0, 8), (0.6, 10, 35), (5.0, 35, 55), (20.0, 95, 100), (37.5, 100, 100)]),
    of(Bs882, "all-in 10 mm", &[(0.15, 0, 8), (0.3, 5, 15), (0.6, 10, 30), (1.18, 15, 40), (2.36, 20, 50),
        (5.0, 30, 65), (10.0, 95, 100), (14.0, 100, 100)]),
    of(Bs882, "all-in 5 mm", &[(0.15, 0, 15), (0.3, 3, 20), (0.6, 5, 25), (1.18, 15, 45), (2.36, 25, 100),
        (5.0, 70, 100), (10.0, 100, 100)]),
    of(Gbt14685, "5-16", &[(2.36, 0, 5), (4.75, 0, 15), (9.5, 40, 70), (16.0, 90, 100), (19.0, 100, 100)]),
    of(Gbt14685, "5-20", &[(2.36, 0, 5), (4.75, 0, 10), (9.5, 20, 60), (19.0, 90, 100), (26.5, 100, 100)]),
    of(Gbt14685, "5-25", &[(2.36, 0, 5), (4.75, 0, 10), (16.0, 30, 70), (26.5, 95, 100), (31.5, 100, 100)]),
    of(Gbt14685, "5-31.5", &[(2.36, 0, 5), (4.75, 0, 10), (9.5, 10, 30), (19.0, 55, 85), (31.5, 95, 100),
        (37.5, 100, 100)]),
    of(Arema, "4", &[(9.5, 0, 5), (19.0, 0, 15), (25.0, 20, 55), (37.5, 90, 100), (50.0, 100, 100)]),
];

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::request::PackingRequest;

    #[test]
    fn every_grading_is_a_band_between_curves() {
        for grading in &GRADINGS {
            let name = format!("{:?} {}", grading.standard, grading.name);
            assert!(
                grading.limits.iter().all(|(mm, low, high)| *mm > 0.0 && low <= high && *high <= 100),
                "{name}"
            );
            for pair in grading.limits.windows(2) {
                let ((a, low, high), (b, next_low, next_high)) = (pair[0], pair[1]);
                assert!(a < b && low <= next_low && high <= next_high, "{name} at {b} mm");
            }
            assert_eq!(grading.limits.last().unwrap().1, 100, "{name}");
            assert!(std::ptr::eq(find(grading.standard, grading.name).unwrap(), grading), "{name}");
            for curve in [LimitCurve::Lower, LimitCurve::Middle, LimitCurve::Upper] {
                let points = grading.points(curve);
                assert!(points.len() >= 2 && points.last().unwrap()[1] == 1.0, "{name}: {points:?}");
                assert!(points.is_sorted() && points[0][1] < points[1][1], "{name}: {points:?}");
            }
        }
        assert_eq!(GRADINGS.iter().filter(|grading| grading.is_curve()).count(), 9);
    }

    #[test]
    fn a_curve_of_a_band_goes_from_nothing_to_all() {
        let of = |curve| find(AstmC33, "57").unwrap().points(curve);
        assert_eq!(of(LimitCurve::Lower), [[4.75, 0.0], [12.5, 0.25], [25.0, 0.95], [37.5, 1.0]]);
        // The next finer sieve of ASTM E11 gets 0.
        assert_eq!(of(LimitCurve::Upper), [[1.18, 0.0], [2.36, 0.05], [4.75, 0.1], [12.5, 0.6], [25.0, 1.0]]);
        let middle = [[1.18, 0.0], [2.36, 0.025], [4.75, 0.05], [12.5, 0.425], [25.0, 0.975], [37.5, 1.0]];
        assert_eq!(of(LimitCurve::Middle), middle);
    }

    #[test]
    fn requests_name_a_grading_by_its_standard() {
        let read = |grading: serde_json::Value| {
            let request = json!({
                "specimen": {"type": "box", "size_mm": [200, 200, 200]},
                "mix": {"grading": grading, "d_min_mm": 4.75, "volume_fraction": 0.4},
            });
            PackingRequest::from_json(&request, 1).map_err(|faults| faults[0].to_string())
        };
        let stored = |grading| serde_json::to_value(read(grading).unwrap().mix.grading.unwrap()).unwrap();
        assert_eq!(
            stored(json!({"type": "standard", "name": "A16"})),
            json!({"type": "standard", "name": "A16"})
        );
        let given = json!({"type": "standard", "standard": "ASTM C33", "name": "57"});
        let named = json!({"type": "standard", "standard": "ASTM C33", "name": "57", "curve": "middle"});
        assert_eq!(stored(given.clone()), named);
        assert_eq!(stored(named.clone()), named);
        let grading = read(given).unwrap().mix.grading.unwrap();
        assert!(grading.completions(2.36, 90.0).is_empty(), "placed from there on");
        let notes = grading.completions(2.0, 90.0);
        assert_eq!(notes.len(), 1);
        assert!(notes[0].contains("1.18 mm was added"), "{notes:?}");
        for (grading, says) in [
            (json!({"type": "standard", "name": "D16"}), "A16"),
            (json!({"type": "standard", "standard": "ASTM C33", "name": "A16"}), "467"),
            (json!({"type": "standard", "standard": "ASTM", "name": "57"}), "ASTM C33"),
            (json!({"type": "standard", "name": "A16", "curve": "lower"}), "one curve"),
        ] {
            let fault = read(grading).unwrap_err();
            assert!(fault.contains(says), "{fault}");
        }
    }
}
