//! Properties that hold for random inputs, by the crate `proptest`, with one copy of its runner for all of them.
//!
//! `proptest!` compiles its runner again for each property: 90 copies were 0.7 MB of machine code in the unit tests.
//! [`properties!`] has the same form, and hands the runner cases of one type, whatever the inputs are.

use std::fmt::{Debug, Formatter};

use proptest::prelude::*;
use proptest::test_runner::{TestCaseResult, TestRunner};

/// Tests of properties, written as for `proptest!`: `fn name(input in strategy, …) { … }`, with the number of cases by
/// `#![proptest_config(…)]` before the first.
macro_rules! properties {
    (#![proptest_config($config:expr)] $($tests:tt)*) => {
        $crate::properties::properties! { @ $config; $($tests)* }
    };
    (@ $config:expr; $(
        $(#[$attribute:meta])*
        fn $name:ident($($input:pat in $strategy:expr),+ $(,)?) $body:block
    )+) => {$(
        $(#[$attribute])*
        fn $name() {
            let config = proptest::test_runner::Config {
                source_file: Some(file!()),
                test_name: Some(concat!(module_path!(), "::", stringify!($name))),
                ..$config
            };
            let names = stringify!($($input),+);
            $crate::properties::hold(config, names, ($($strategy,)+), |($($input,)+)| {
                $body
                Ok(())
            });
        }
    )+};
    ($(#[$attribute:meta])+ fn $($tests:tt)+) => {
        $crate::properties::properties! {
            @ proptest::test_runner::Config::default(); $(#[$attribute])+ fn $($tests)+
        }
    };
}
pub(crate) use properties;

/// A property with inputs that it shall hold for.
trait Case: Debug {
    fn holds(self: Box<Self>) -> TestCaseResult;
}

struct Inputs<V> {
    names: &'static str,
    values: V,
    property: fn(V) -> TestCaseResult,
}

impl<V: Debug> Debug for Inputs<V> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "({}) = {:?}", self.names, self.values)
    }
}

impl<V: Debug> Case for Inputs<V> {
    fn holds(self: Box<Self>) -> TestCaseResult {
        (self.property)(self.values)
    }
}

/// Panics with the least inputs found for which `property` does not hold.
pub(crate) fn hold<S>(
    config: ProptestConfig,
    names: &'static str,
    strategy: S,
    property: fn(S::Value) -> TestCaseResult,
) where
    S: Strategy + 'static,
    S::Value: 'static,
{
    let case = move |values| Box::new(Inputs { names, values, property }) as Box<dyn Case>;
    run(config, &strategy.prop_map(case).boxed());
}

fn run(config: ProptestConfig, cases: &BoxedStrategy<Box<dyn Case>>) {
    let mut runner = TestRunner::new(config);
    if let Err(error) = runner.run(cases, Case::holds) {
        panic!("{error}\n{runner}");
    }
}

properties! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    #[should_panic(expected = "minimal failing input: (n, sign) = (100, ")]
    fn the_least_input_that_breaks_a_property_is_told(n in 0..10_000_u32, sign in any::<bool>()) {
        prop_assert!(n < 100, "{n} {sign}");
    }
}
