use std::f64::consts::{E, FRAC_PI_6, PI};

use crate::properties::properties;
use proptest::prelude::*;

use super::*;
use crate::cpu::tests::on_baseline;

/// Values of all functions for many arguments, some of which have no value.
fn values() -> Vec<f64> {
    let mut values = Vec::new();
    for i in 0..5000 {
        let x = (f64::from(i) + 0.5) / 5000.0;
        let (large, signed) = (100.0 * x, 2.0 * x - 1.0);
        let wide = exp2(2200.0 * signed);
        values.extend([
            powf(large, 3.0 * signed),
            powf(x, large),
            powf(wide, signed),
            powf(-large, f64::from(i % 9 - 4)),
            exp(7.0 * signed),
            exp(800.0 * signed),
            exp2(7.0 * signed),
            wide,
            exp_m1(signed),
            ln(large),
            ln(1.0 + 0.07 * signed),
            ln(wide),
            ln_1p(x),
            log2(large),
            log2(1.0 + 0.05 * signed),
            log2(wide),
            log10(large),
            sin(large),
            cos(large),
            sin_cos(-large).0,
            tan(signed),
            asin(signed),
            acos(signed),
            atan(large),
            atan2(signed, x),
            hypot(large, x),
            cbrt(signed),
        ]);
    }
    values
}

fn crc(values: &[f64]) -> u32 {
    let mut sum = crc32fast::Hasher::new();
    for value in values {
        sum.update(&value.to_le_bytes());
    }
    sum.finalize()
}

/// The sum was made of the values of the GNU C library 2.36 for exponential functions, logarithms and powers, on a
/// processor with fused multiply-add.
#[test]
fn the_bits_are_the_same_on_every_machine() {
    let values = values();
    assert!(values.iter().all(|value| !value.is_nan()));
    assert_eq!(format!("{:08x}", crc(&values)), "c46f98de");
    assert_eq!(crc(&on_baseline(self::values)), crc(&values));
}

/// Differs by at most one place from the standard library, whose error is below one as well.
fn is_near(own: f64, standard: f64) -> bool {
    own.to_bits() == standard.to_bits()
        || own.is_nan() && standard.is_nan()
        || (own.to_bits().cast_signed() - standard.to_bits().cast_signed()).abs() <= 1
}

properties! {
    #[test]
    fn functions_of_any_number_are_those_of_the_standard_library(bits in any::<u64>()) {
        let x = f64::from_bits(bits);
        prop_assert!(is_near(exp(x), x.exp()), "exp({x:e})");
        prop_assert!(is_near(exp2(x), x.exp2()), "exp2({x:e})");
        prop_assert!(is_near(ln(x), x.ln()), "ln({x:e})");
        prop_assert!(is_near(log2(x), x.log2()), "log2({x:e})");
    }

    #[test]
    fn lengths_of_any_sides_are_those_of_the_standard_library(x in any::<u64>(), ratio in -2e16..2e16_f64) {
        let x = f64::from_bits(x);
        for y in [x * ratio, x / ratio, ratio] {
            prop_assert!(is_near(hypot(x, y), x.hypot(y)), "hypot({x:e}, {y:e})");
        }
    }

    #[test]
    fn powers_of_any_number_are_those_of_the_standard_library(
        bits in any::<u64>(), y in prop_oneof![any::<f64>(), -20.0..20.0, (-20..20_i32).prop_map(f64::from)],
    ) {
        let x = f64::from_bits(bits);
        prop_assert!(is_near(powf(x, y), x.powf(y)), "powf({x:e}, {y:e})");
    }

    #[test]
    fn functions_of_usual_numbers_are_those_of_the_standard_library(x in 1e-3..1e3_f64, y in -6.0..6.0_f64) {
        for (own, standard) in [
            (exp(y), y.exp()),
            (exp2(y), y.exp2()),
            (exp_m1(y), y.exp_m1()),
            (ln(x), x.ln()),
            (ln_1p(x), x.ln_1p()),
            (log2(x), x.log2()),
            (log10(x), x.log10()),
            (powf(x, y), x.powf(y)),
            (sin(y), y.sin()),
            (cos(y), y.cos()),
            (tan(y), y.tan()),
            (asin(y / 6.0), (y / 6.0).asin()),
            (acos(y / 6.0), (y / 6.0).acos()),
            (atan(y), y.atan()),
            (atan2(y, x), y.atan2(x)),
            (hypot(x, y), x.hypot(y)),
            (cbrt(y), y.cbrt()),
        ] {
            prop_assert!(is_near(own, standard), "{own:e} {standard:e}");
        }
        prop_assert_eq!(sin_cos(y), (sin(y), cos(y)));
    }
}

#[test]
fn limits_and_what_has_no_value() {
    let (infinite, negative) = (f64::INFINITY, f64::NEG_INFINITY);
    let special = [
        0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 2.0, -2.0, 3.0, -3.0, 1e300, -1e300, 1e-300, 5e-324, -5e-324,
        infinite, negative,
    ];
    for x in special.into_iter().chain([f64::NAN]) {
        for y in special.into_iter().chain([f64::NAN]) {
            let (own, standard) = (powf(x, y), x.powf(y));
            assert!(
                own.to_bits() == standard.to_bits() || own.is_nan() && standard.is_nan(),
                "powf({x:e}, {y:e})"
            );
        }
    }
    assert_eq!([hypot(negative, f64::NAN), hypot(0.0, -0.0), hypot(-3.0, 0.0)], [infinite, 0.0, 3.0]);
    assert!(hypot(f64::NAN, 1.0).is_nan());
    assert_eq!([exp(negative), exp(-750.0), exp(0.0), exp(710.0)], [0.0, 0.0, 1.0, infinite]);
    assert_eq!([exp2(negative), exp2(-1075.0), exp2(-1074.0), exp2(1024.0)], [0.0, 0.0, 5e-324, infinite]);
    assert_eq!([ln(0.0), ln(1.0), ln(infinite)], [negative, 0.0, infinite]);
    assert_eq!([log2(5e-324), log2(1.0), log2(1024.0)], [-1074.0, 0.0, 10.0]);
    assert!(
        [exp(f64::NAN), exp2(f64::NAN), ln(-1.0), ln(f64::NAN), log2(-5e-324)].iter().all(|x| x.is_nan())
    );
}

#[test]
fn known_values() {
    assert_eq!([exp(1.0), ln(E), powf(2.0, 0.5)], [E, 1.0, 2.0_f64.sqrt()]);
    assert_eq!([powf(10.0, 3.0), powf(2.0, -2.0), powf(-2.0, 3.0), cbrt(27.0)], [1000.0, 0.25, -8.0, 3.0]);
    assert_eq!([acos(-1.0), atan2(0.0, -1.0), hypot(3.0, 4.0), log10(1000.0)], [PI, PI, 5.0, 3.0]);
    assert!((sin(FRAC_PI_6) - 0.5).abs() < 1e-15);
}
