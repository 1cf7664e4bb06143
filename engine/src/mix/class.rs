//! One size class `a..b` and the distribution of diameters in it, with the closed forms that follow.
//!
//! Let `F(d)` be the mass fraction passing `d`. The number of grains per diameter is proportional to `F'(d) / d^3`.
//!
//! - `F` linear in `ln d` ([`Law::LogUniform`]): the number distribution is
//!   `F_N(d) = (a^-3 - d^-3) / (a^-3 - b^-3)`. A grain is sampled from `u` in `[0, 1)` by `d = a b / (b^3 (1 - u) + a^3
//!   u)^(1/3)`, and a volume `V` has `N = V (a^-3 - b^-3) / (3 ln(b/a)) / (pi/6)` grains on average.
//! - Fuller's curve `F = (d / d_max)^q` ([`Law::Fuller`]): with `s = q - 3`,
//!   `F_N(d) = (a^s - d^s) / (a^s - b^s)`, `d = (a^s - u (a^s - b^s))^(1/s)`, and
//!   `N = V q (b^s - a^s) / (s (b^q - a^q)) / (pi/6)`.
//! - A law of sizes ([`Law::Distribution`]) has no such forms: it is divided into narrow classes with `F` linear in
//!   `ln d`.
//!
//! Shaped grains have shapes that do not depend on their size, so that the distributions of sizes stay and
//! the numbers are divided by the mean of their volume over that of the sphere of the same size
//! ([`Class::volume_ratio`]).

use super::{distribution, sphere_volume};
use crate::elementary::{cbrt, exp, exp2, ln, log2, powf};
use crate::request::Distribution;

/// How mass is spread over the diameters of a class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// `F` linear in `ln d`: the mass density is `1 / (d ln(b/a))`.
    LogUniform,
    /// Fuller: the mass density is proportional to `d^(exponent - 1)`.
    Fuller {
        /// Exponent `q`, `0 < q <= 1`.
        exponent: f64,
    },
    /// A law of sizes, which is divided into narrow classes before grains are drawn from it.
    Distribution(Distribution),
    /// All grains of one diameter.
    Single,
}

/// A class `low..high` of diameters and its share of the aggregate's mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Class {
    /// Law of diameters inside the class.
    pub law: Law,
    /// Lower bound `a`.
    pub low_mm: f64,
    /// Upper bound `b`.
    pub high_mm: f64,
    /// `F(b) - F(a)`.
    pub mass_fraction: f64,
    /// Mean volume of a grain over that of a sphere of the drawn diameter; 1 for spheres.
    pub volume_ratio: f64,
    /// Which of the parts of the mix its grains belong to ([`Mix::parts`](crate::request::Mix::parts)).
    pub part: u16,
}

impl Class {
    /// The part of the class above a cut-off, if any is.
    pub fn above(self, d_min: f64) -> Option<Self> {
        if d_min <= self.low_mm {
            return Some(self);
        }
        if d_min >= self.high_mm {
            return None;
        }
        Some(Self {
            low_mm: d_min,
            mass_fraction: self.mass_fraction * self.mass_share(d_min, self.high_mm),
            ..self
        })
    }

    /// The part of the class below a largest diameter, if any is.
    pub fn below(self, d_max: f64) -> Option<Self> {
        if d_max >= self.high_mm {
            return Some(self);
        }
        if d_max <= self.low_mm {
            return None;
        }
        Some(Self {
            high_mm: d_max,
            mass_fraction: self.mass_fraction * self.mass_share(self.low_mm, d_max),
            ..self
        })
    }

    /// The class in parts of at most a twelfth of an octave, with the same law.
    pub fn narrow(&self) -> Vec<Self> {
        if let Law::Distribution(law) = &self.law {
            return self.narrow_of_law(law);
        }
        let octaves = log2(self.high_mm / self.low_mm);
        let n = (octaves * super::CLASSES_PER_OCTAVE).ceil().max(1.0) as usize;
        let edge = |i: usize| match i {
            0 => self.low_mm,
            i if i == n => self.high_mm,
            i => self.low_mm * exp2(octaves * i as f64 / n as f64),
        };
        (0..n)
            .map(|i| {
                let (low_mm, high_mm) = (edge(i), edge(i + 1));
                let mass_fraction = self.mass_fraction * self.mass_share(low_mm, high_mm);
                Self { low_mm, high_mm, mass_fraction, ..*self }
            })
            .collect()
    }

    /// Share of the class's mass between two diameters inside it.
    pub fn mass_share(&self, from: f64, to: f64) -> f64 {
        let (a, b) = (self.low_mm, self.high_mm);
        match self.law {
            Law::LogUniform => ln(to / from) / ln(b / a),
            Law::Fuller { exponent: q } => (powf(to, q) - powf(from, q)) / (powf(b, q) - powf(a, q)),
            Law::Distribution(law) => distribution::mass(&law, from, to) / distribution::mass(&law, a, b),
            Law::Single => 1.0,
        }
    }

    /// Expected number of grains per mm³ of the class's volume: `N_i / V_i`.
    pub fn grains_per_volume(&self) -> f64 {
        let (a, b) = (self.low_mm, self.high_mm);
        let spheres = match self.law {
            Law::LogUniform => (a.powi(-3) - b.powi(-3)) / (3.0 * ln(b / a)) / std::f64::consts::FRAC_PI_6,
            Law::Fuller { exponent: q } => {
                q * (powf(b, q - 3.0) - powf(a, q - 3.0))
                    / ((q - 3.0) * (powf(b, q) - powf(a, q)))
                    / std::f64::consts::FRAC_PI_6
            }
            Law::Distribution(_) => return self.grains_per_volume_of_law(),
            Law::Single => 1.0 / sphere_volume(a),
        };
        spheres / self.volume_ratio
    }

    /// The diameter at which the number CDF equals `u`, `0 <= u < 1`.
    pub fn diameter(&self, u: f64) -> f64 {
        let (a, b) = (self.low_mm, self.high_mm);
        let d = match self.law {
            Law::LogUniform => a * b / cbrt(b * b * b * (1.0 - u) + a * a * a * u),
            Law::Fuller { exponent: q } => {
                let s = q - 3.0;
                let (a_s, b_s) = (powf(a, s), powf(b, s));
                powf(a_s - u * (a_s - b_s), 1.0 / s)
            }
            Law::Distribution(_) => self.diameter_of_law(u),
            Law::Single => a,
        };
        // Rounding may leave the class by a last digit; the grading check must not see that.
        d.clamp(a, b)
    }

    /// Mean over the grains (by number) of a smooth function of the diameter: the integral over
    /// the number CDF by Gauss-Legendre on 16 panels, to about 1e-12.
    pub fn mean_of(&self, f: &dyn Fn(f64) -> f64) -> f64 {
        const PANELS: usize = 16;
        // Three-point rule; see Abramowitz and Stegun, table 25.4.
        const NODE: f64 = 0.774_596_669_241_483_4;
        const NODES: [(f64, f64); 3] = [(-NODE, 5.0 / 9.0), (0.0, 8.0 / 9.0), (NODE, 5.0 / 9.0)];
        // In u the coarse end is steep; in ln d the integrand is smooth. Weight by dF_N/dln d ~ d^(q-3).
        let q = match self.law {
            Law::LogUniform => 0.0,
            Law::Fuller { exponent } => exponent,
            Law::Distribution(_) => return self.mean_of_law(f),
            Law::Single => return f(self.low_mm),
        };
        let (from, to) = (ln(self.low_mm), ln(self.high_mm));
        let half = (to - from) / (2.0 * PANELS as f64);
        let (mut weighted, mut weights) = (0.0, 0.0);
        for panel in 0..PANELS {
            let middle = from + half * (2.0 * panel as f64 + 1.0);
            for (node, weight) in NODES {
                let d = exp(middle + half * node);
                let w = weight * powf(d / self.low_mm, q - 3.0);
                weighted += w * f(d);
                weights += w;
            }
        }
        weighted / weights
    }
    /// [`Self::narrow`] for a law of sizes.
    fn narrow_of_law(&self, law: &Distribution) -> Vec<Self> {
        let intervals = distribution::intervals(law, self.low_mm, self.high_mm);
        let all: f64 = intervals.iter().map(|interval| interval[2]).sum();
        let with_mass = intervals.into_iter().filter(|interval| interval[2] > 0.0);
        with_mass
            .map(|[low_mm, high_mm, mass]| Self {
                law: Law::LogUniform,
                low_mm,
                high_mm,
                mass_fraction: self.mass_fraction * mass / all,
                ..*self
            })
            .collect()
    }

    /// [`Self::grains_per_volume`] for a law of sizes.
    fn grains_per_volume_of_law(&self) -> f64 {
        let parts = self.narrow();
        let grains: f64 = parts.iter().map(|part| part.mass_fraction * part.grains_per_volume()).sum();
        grains / parts.iter().map(|part| part.mass_fraction).sum::<f64>()
    }

    /// [`Self::mean_of`] for a law of sizes.
    fn mean_of_law(&self, f: &dyn Fn(f64) -> f64) -> f64 {
        let (mut weighted, mut weights) = (0.0, 0.0);
        for part in self.narrow() {
            let grains = part.mass_fraction * part.grains_per_volume();
            weighted += grains * part.mean_of(f);
            weights += grains;
        }
        weighted / weights
    }

    /// [`Self::diameter`] for a law of sizes.
    fn diameter_of_law(&self, u: f64) -> f64 {
        let parts = self.narrow();
        let grains = |part: &Self| part.mass_fraction * part.grains_per_volume();
        let mut rest = u * parts.iter().map(grains).sum::<f64>();
        for part in &parts {
            let here = grains(part);
            if rest < here {
                return part.diameter(rest / here);
            }
            rest -= here;
        }
        self.high_mm
    }
}
