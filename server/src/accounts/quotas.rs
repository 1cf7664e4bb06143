//! Bounds of what the jobs of one owner may take.

use serde::Serialize;

/// Stands for no bound in the file of keys, where another bound would hold by default.
pub(super) const NONE: &str = "none";

/// What the file of keys says of a bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Word<T> {
    /// Nothing: the default of the server holds.
    #[default]
    Absent,
    /// There is none, whatever the default is.
    Unbounded,
    Bound(T),
}

impl<T> Word<T> {
    /// The bound, with the default of the server where the file says nothing.
    pub(super) fn over(self, default: Option<T>) -> Option<T> {
        match self {
            Self::Absent => default,
            Self::Unbounded => None,
            Self::Bound(bound) => Some(bound),
        }
    }

    /// Reads the value of a word, which is a bound or `none`.
    pub(super) fn read<E>(text: &str, bound: impl FnOnce(&str) -> Result<T, E>) -> Result<Self, E> {
        if text == NONE { Ok(Self::Unbounded) } else { bound(text).map(Self::Bound) }
    }
}

/// Bounds of what the jobs of one owner may take, whichever of the owner's keys brought them; `null` where there is no
/// bound but those of the server.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Quotas {
    /// Most jobs that wait.
    #[serde(rename = "max_queued")]
    #[cfg_attr(test, schema(required))]
    pub(crate) queued: Option<u64>,
    /// Most jobs that run at once.
    #[serde(rename = "max_running")]
    #[cfg_attr(test, schema(required))]
    pub(crate) running: Option<u64>,
    /// Most grains of one packing.
    #[serde(rename = "max_grains")]
    #[cfg_attr(test, schema(required))]
    pub(crate) grains: Option<u64>,
    /// Most bytes of results and kept exports together.
    #[serde(rename = "max_stored_bytes")]
    #[cfg_attr(test, schema(required))]
    pub(crate) stored_bytes: Option<u64>,
}

/// What the file of keys says of quotas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct QuotaWords {
    queued: Word<u64>,
    running: Word<u64>,
    grains: Word<u64>,
    stored_bytes: Word<u64>,
}

impl QuotaWords {
    fn fields(&mut self) -> [(&'static str, &mut Word<u64>); 4] {
        [
            ("max_queued", &mut self.queued),
            ("max_running", &mut self.running),
            ("max_grains", &mut self.grains),
            ("max_stored_bytes", &mut self.stored_bytes),
        ]
    }

    /// Takes a word of a line; `None` where no quota has that name.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub(super) fn take(&mut self, name: &str, value: &str) -> Option<Result<(), String>> {
        let (_, field) = self.fields().into_iter().find(|(known, _)| *known == name)?;
        let Ok(word) = Word::read(value, str::parse) else {
            return Some(Err(format!("{name}={value}: must be a whole number or {NONE}")));
        };
        Some(match std::mem::replace(field, word) {
            Word::Absent => Ok(()),
            _ => Err(format!("{name}= is given more than once")),
        })
    }

    /// The name of a quota that these words set and the `first` line of the same owner does not, or sets to another
    /// value.
    pub(super) fn beyond(mut self, mut first: Self) -> Option<&'static str> {
        let both = self.fields().into_iter().zip(first.fields());
        both.into_iter()
            .find(|((_, own), (_, first))| **own != Word::Absent && own != first)
            .map(|((name, _), _)| name)
    }

    /// The quotas, with the defaults of the server for what the file does not say.
    pub(super) fn over(self, defaults: Quotas) -> Quotas {
        Quotas {
            queued: self.queued.over(defaults.queued),
            running: self.running.over(defaults.running),
            grains: self.grains.over(defaults.grains),
            stored_bytes: self.stored_bytes.over(defaults.stored_bytes),
        }
    }

    /// Whether a number of running jobs is given.
    pub(super) fn bounds_running(&self) -> bool {
        matches!(self.running, Word::Bound(_))
    }
}
