//! Types of query parameters: what the interface document says of each, how it is read, and how it is written.

#[cfg(test)]
use utoipa::openapi::Required;
#[cfg(test)]
use utoipa::openapi::path::{ParameterBuilder, ParameterStyle};
#[cfg(test)]
use utoipa::openapi::schema::{ArrayBuilder, KnownFormat, Object, ObjectBuilder, SchemaFormat, Type};

#[cfg(test)]
use crate::http::params::described::{uuid_schema, with_default};
use crate::http::params::{Choice, shown};
use crate::ids::StudyId;
use crate::jobs;
use crate::jobs::moments;
use crate::jobs::request::MAX_LABELS;

/// What one text of a query means.
pub(crate) trait Value: Sized {
    /// The texts that there are.
    #[cfg(test)]
    fn schema() -> Object;

    /// Reads the text.
    ///
    /// # Errors
    /// What is wrong with the text, which it names.
    fn read(text: &str) -> Result<Self, String>;

    /// The text that reads back as this value.
    fn write(&self) -> String;
}

/// What all texts of one name in a query mean, or their absence.
pub(crate) trait Parameter: Sized {
    /// Adds the schema, and how it is written where that is not the plain way.
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder;

    /// Reads the texts; `None` where they are faulty, which `fault` is told.
    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self>;

    /// The texts that read back as this.
    fn write(&self) -> Vec<String>;
}

/// A value that may be absent.
impl<T: Value> Parameter for Option<T> {
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder {
        parameter.schema(Some(T::schema()))
    }

    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self> {
        let text = match &*texts {
            [] => return Some(None),
            [text] => text,
            several => {
                fault(format!("is given {} times: must be given once", several.len()));
                return None;
            }
        };
        T::read(text).map_err(fault).ok().map(Some)
    }

    fn write(&self) -> Vec<String> {
        self.iter().map(T::write).collect()
    }
}

/// A SHA-256 in hexadecimal, which must be given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Sha256(pub(crate) String);

impl Value for Sha256 {
    #[cfg(test)]
    fn schema() -> Object {
        ObjectBuilder::new().schema_type(Type::String).pattern(Some("^[0-9a-f]{64}$")).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
        if text.len() == 64 && text.bytes().all(is_digit) {
            return Ok(Self(text.to_owned()));
        }
        Err(format!("{} is no SHA-256: must be 64 hexadecimal digits in lower case", shown(text)))
    }

    fn write(&self) -> String {
        self.0.clone()
    }
}

impl Parameter for Sha256 {
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder {
        parameter.schema(Some(<Self as Value>::schema())).required(Required::True)
    }

    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self> {
        let found = <Option<Self> as Parameter>::read(texts, fault)?;
        if found.is_none() {
            fault("is missing: must be given".into());
        }
        found
    }

    fn write(&self) -> Vec<String> {
        vec![<Self as Value>::write(self)]
    }
}

/// Makes a type that wraps a value a parameter that has a default where it is absent.
fn read_or<T: Value>(texts: Vec<String>, fault: &mut dyn FnMut(String), default: T) -> Option<T> {
    <Option<T> as Parameter>::read(texts, fault).map(|given| given.unwrap_or(default))
}

/// A choice that is the default of its type where it is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct OrDefault<T>(pub(crate) T);

impl<T: Choice + Default> Parameter for OrDefault<T> {
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder {
        parameter.schema(Some(with_default::<T>(T::default().name())))
    }

    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self> {
        read_or(texts, fault, T::default()).map(Self)
    }

    fn write(&self) -> Vec<String> {
        vec![self.0.write()]
    }
}

/// A whole number in `MIN..=MAX`, or `DEFAULT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WholeNumber<const MIN: u32, const MAX: u32, const DEFAULT: u32>(u32);

impl<const MIN: u32, const MAX: u32, const DEFAULT: u32> WholeNumber<MIN, MAX, DEFAULT> {
    /// The number.
    pub(crate) fn get(self) -> u32 {
        self.0
    }
}

impl<const MIN: u32, const MAX: u32, const DEFAULT: u32> Value for WholeNumber<MIN, MAX, DEFAULT> {
    #[cfg(test)]
    fn schema() -> Object {
        ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(MIN)).maximum(Some(MAX)).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        let number = text.parse().ok().filter(|number| (MIN..=MAX).contains(number));
        number.map(Self).ok_or_else(|| {
            format!("{} is out of range: must be a whole number from {MIN} to {MAX}", shown(text))
        })
    }

    fn write(&self) -> String {
        self.0.to_string()
    }
}

impl<const MIN: u32, const MAX: u32, const DEFAULT: u32> Parameter for WholeNumber<MIN, MAX, DEFAULT> {
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder {
        parameter.schema(Some(with_default::<Self>(DEFAULT)))
    }

    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self> {
        read_or(texts, fault, Self(DEFAULT))
    }

    fn write(&self) -> Vec<String> {
        vec![Value::write(self)]
    }
}

impl Value for bool {
    #[cfg(test)]
    fn schema() -> Object {
        ObjectBuilder::new().schema_type(Type::Boolean).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        match text {
            "false" => Ok(false),
            "true" => Ok(true),
            other => Err(format!("{} is unknown: must be true or false", shown(other))),
        }
    }

    fn write(&self) -> String {
        self.to_string()
    }
}

/// `true` or `false`, or `DEFAULT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Flag<const DEFAULT: bool>(bool);

impl<const DEFAULT: bool> Flag<DEFAULT> {
    /// Whether it is set.
    pub(crate) fn get(self) -> bool {
        self.0
    }
}

impl<const DEFAULT: bool> Parameter for Flag<DEFAULT> {
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder {
        parameter.schema(Some(with_default::<bool>(DEFAULT)))
    }

    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self> {
        read_or(texts, fault, DEFAULT).map(Self)
    }

    fn write(&self) -> Vec<String> {
        vec![self.0.write()]
    }
}

/// A text of `MIN` to `MAX` characters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Text<const MIN: usize, const MAX: usize>(pub(crate) String);

impl<const MIN: usize, const MAX: usize> Value for Text<MIN, MAX> {
    #[cfg(test)]
    fn schema() -> Object {
        let text = ObjectBuilder::new().schema_type(Type::String);
        text.min_length(Some(MIN)).max_length(Some(MAX)).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        let chars = text.chars().count();
        if (MIN..=MAX).contains(&chars) {
            Ok(Self(text.to_owned()))
        } else {
            Err(format!("has {chars} characters: must have at least {MIN} and at most {MAX}"))
        }
    }

    fn write(&self) -> String {
        self.0.clone()
    }
}

/// A time, in microseconds since the Unix epoch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Time(pub(crate) i64);

impl Value for Time {
    #[cfg(test)]
    fn schema() -> Object {
        let format = SchemaFormat::KnownFormat(KnownFormat::DateTime);
        ObjectBuilder::new().schema_type(Type::String).format(Some(format)).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        moments::read(text)
            .map(Self)
            .ok_or_else(|| format!("{} is not an RFC 3339 time, as 2030-01-31T12:00:00Z", shown(text)))
    }

    fn write(&self) -> String {
        moments::text(self.0)
    }
}

impl Value for StudyId {
    #[cfg(test)]
    fn schema() -> Object {
        uuid_schema()
    }

    fn read(text: &str) -> Result<Self, String> {
        Self::parse(text)
            .ok_or_else(|| format!("{} is no id of a study: must be a hyphenated UUID", shown(text)))
    }

    fn write(&self) -> String {
        self.to_string()
    }
}

/// A choice that may not exist: what then happens is for the handler to say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Named<T> {
    /// One that there is.
    Known(T),
    /// A name that none has.
    Unknown(String),
}

impl<T: Choice> Value for Named<T> {
    #[cfg(test)]
    fn schema() -> Object {
        <T as Value>::schema()
    }

    fn read(text: &str) -> Result<Self, String> {
        Ok(T::read(text).map_or_else(|_| Self::Unknown(text.to_owned()), Self::Known))
    }

    fn write(&self) -> String {
        match self {
            Self::Known(choice) => choice.write(),
            Self::Unknown(name) => name.clone(),
        }
    }
}

/// Keys and values of labels, each as `key=value`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Labels(pub(crate) Vec<(String, String)>);

impl Parameter for Labels {
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder {
        let label = ObjectBuilder::new().schema_type(Type::String).pattern(Some("^[^=]+=")).build();
        let labels = ArrayBuilder::new().items(label).max_items(Some(MAX_LABELS)).build();
        parameter.schema(Some(labels)).explode(Some(true)).example(Some(serde_json::json!(["series=TB-7"])))
    }

    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self> {
        let given = texts.len();
        let mut labels = Vec::new();
        for text in texts {
            match text.split_once('=') {
                Some((key, value)) if !key.is_empty() => labels.push((key.into(), value.into())),
                _ => fault(format!("{} has no key: must be key=value", shown(&text))),
            }
        }
        if labels.len() > MAX_LABELS {
            fault(format!("is given {} times: must be given at most {MAX_LABELS} times", labels.len()));
            return None;
        }
        (labels.len() == given).then_some(Self(labels))
    }

    fn write(&self) -> Vec<String> {
        self.0.iter().map(|(key, value)| format!("{key}={value}")).collect()
    }
}

/// States of jobs that can be retried, separated by commas; those that failed where it is absent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RetriedStates(pub(crate) Vec<jobs::State>);

impl RetriedStates {
    const DEFAULT: jobs::State = jobs::State::Failed;

    fn all() -> impl Iterator<Item = jobs::State> {
        jobs::State::ALL.into_iter().filter(|state| state.may_retry())
    }
}

impl Parameter for RetriedStates {
    #[cfg(test)]
    fn describe(parameter: ParameterBuilder) -> ParameterBuilder {
        let names = Self::all().map(jobs::State::name);
        let state = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(names));
        let states = ArrayBuilder::new().items(state.build()).min_items(Some(1)).unique_items(true);
        let states = states.default(Some(serde_json::json!([Self::DEFAULT.name()])));
        parameter.schema(Some(states.build())).style(Some(ParameterStyle::Form)).explode(Some(false))
    }

    fn read(texts: Vec<String>, fault: &mut dyn FnMut(String)) -> Option<Self> {
        let Some(given) = <Option<Text<0, { usize::MAX }>> as Parameter>::read(texts, fault)? else {
            return Some(Self(vec![Self::DEFAULT]));
        };
        let (mut states, mut faulty) = (Vec::new(), false);
        let mut note = |detail| {
            faulty = true;
            fault(detail);
        };
        for name in given.0.split(',') {
            match Self::all().find(|state| state.name() == name) {
                Some(state) if !states.contains(&state) => states.push(state),
                Some(_) => note(format!("{} comes twice", shown(name))),
                None => {
                    note(format!("{} cannot be retried: must be failed, cancelled, or both", shown(name)));
                }
            }
        }
        (!faulty).then_some(Self(states))
    }

    fn write(&self) -> Vec<String> {
        vec![self.0.iter().map(|state| state.name()).collect::<Vec<_>>().join(",")]
    }
}
