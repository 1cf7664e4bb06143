//! Names of what the service keeps: UUIDv7, so that they rise with time.

use serde::{Deserialize, Serialize};
use uuid::Uuid;

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub(crate) struct $name(Uuid);

        impl $name {
            /// A fresh one.
            pub(crate) fn new() -> Self {
                Self(Uuid::now_v7())
            }

            /// Reads the hyphenated form, the only one that this service writes.
            pub(crate) fn parse(text: &str) -> Option<Self> {
                (text.len() == 36).then(|| Uuid::try_parse(text).ok()).flatten().map(Self)
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                self.0.as_hyphenated().fmt(f)
            }
        }
    )*};
}

ids! {
    /// Name of a job.
    JobId
    /// Name of a study.
    StudyId
    /// Name of something made of a result.
    ExportId
    /// Name of a job or an export, as a lease has it.
    TaskId
}

impl TaskId {
    /// The job of that name.
    pub(crate) fn job(self) -> JobId {
        JobId(self.0)
    }

    /// The export of that name.
    pub(crate) fn export(self) -> ExportId {
        ExportId(self.0)
    }
}

impl From<JobId> for TaskId {
    fn from(JobId(id): JobId) -> Self {
        Self(id)
    }
}

impl From<ExportId> for TaskId {
    fn from(ExportId(id): ExportId) -> Self {
        Self(id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_hyphenated_ids_are_ids() {
        let id = JobId::new();
        assert_eq!(JobId::parse(&id.to_string()), Some(id));
        assert_eq!(JobId::parse(&id.to_string().replace('-', "")), None);
        assert_eq!(JobId::parse("urn:uuid:00000000-0000-0000-0000-000000000000"), None);
        assert_eq!(JobId::parse(""), None);
    }

    #[test]
    fn ids_rise() {
        let ids: Vec<String> = (0..1000).map(|_| JobId::new().to_string()).collect();
        assert!(ids.is_sorted());
    }
}
