//! Values for the parameters of a query.

/// A value of one of the four types that the tables have; `None` is null of that type, for PostgreSQL wants to know it.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) enum Value {
    Integer(Option<i64>),
    Real(Option<f64>),
    Flag(Option<bool>),
    Text(Option<String>),
}

/// What can be bound.
pub(in super::super) trait Bind {
    /// Null of this type.
    const NULL: Value;

    /// The value to bind.
    fn value(self) -> Value;
}

macro_rules! bind {
    ($($type:ty => $kind:ident),*) => {$(
        impl Bind for $type {
            const NULL: Value = Value::$kind(None);

            fn value(self) -> Value {
                Value::$kind(Some(self.into()))
            }
        }
    )*};
}

bind!(
    i64 => Integer, i32 => Integer, u32 => Integer, u16 => Integer, f64 => Real, bool => Flag, String => Text,
    &str => Text
);

impl<T: Bind + Clone> Bind for &T {
    const NULL: Value = T::NULL;

    fn value(self) -> Value {
        self.clone().value()
    }
}

impl<T: Bind> Bind for Option<T> {
    const NULL: Value = T::NULL;

    fn value(self) -> Value {
        self.map_or(T::NULL, T::value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn null_has_the_type_of_the_value_that_is_absent() {
        assert_eq!(Some(7_u32).value(), Value::Integer(Some(7)));
        assert_eq!(None::<u16>.value(), Value::Integer(None));
        assert_eq!((&None::<String>).value(), Value::Text(None));
        assert_eq!((&"a".to_owned()).value(), "a".value());
        assert_eq!(Some(true).value(), Value::Flag(Some(true)));
        assert_eq!(None::<f64>.value(), Value::Real(None));
    }
}
