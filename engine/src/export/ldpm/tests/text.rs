use proptest::prelude::*;

use super::super::text::{push_number, push_whole};

fn number(x: f64) -> String {
    let mut text = Vec::new();
    push_number(&mut text, x);
    String::from_utf8(text).unwrap()
}

#[test]
fn numbers_look_like_those_of_c() {
    for (x, expected) in [
        (0.0, "0"),
        (-0.0, "0"),
        (1.0, "1"),
        (-150.0, "-150"),
        (0.1, "0.1"),
        (1.0 / 3.0, "0.3333333333"),
        (2.0e3 / 3.0, "666.6666667"),
        (9_999_999_999.4, "9999999999"),
        (9_999_999_999.6, "1e+10"),
        (0.000_123_456_789_012, "0.000123456789"),
        (0.000_012_345_678_901_2, "1.23456789e-05"),
        (-1.5e-12, "-1.5e-12"),
        (0.999_999_999_99, "1"),
        (1e300, "1e+300"),
    ] {
        assert_eq!(number(x), expected, "{x:e}");
    }
}

proptest! {
    #[test]
    fn numbers_read_back_to_ten_digits(x in prop::num::f64::NORMAL) {
        let read: f64 = number(x).parse().unwrap();
        prop_assert!(((read - x) / x).abs() <= 5.000_001e-10, "{x:e} became {read:e}");
    }

    #[test]
    fn lengths_are_rounded_as_the_library_rounds(x in -1.0e4..1.0e4_f64) {
        let rounded: f64 = format!("{x:.9e}").parse().unwrap();
        prop_assert_eq!(number(x).parse::<f64>().unwrap(), rounded);
    }

    #[test]
    fn whole_numbers_read_back(x: u64) {
        let mut text = Vec::new();
        push_whole(&mut text, x);
        prop_assert_eq!(String::from_utf8(text).unwrap(), x.to_string());
    }
}
