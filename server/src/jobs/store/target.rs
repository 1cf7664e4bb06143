//! Which job or study a client means, and in which version.

use super::StoreError;

/// A job or a study, and the versions of it that the client accepts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Target<Id> {
    pub(crate) id: Id,
    /// Versions of which the present one must be (`If-Match`, RFC 9110, section 13.1.1); any if absent.
    pub(crate) versions: Option<Vec<i64>>,
}

impl<Id> From<Id> for Target<Id> {
    fn from(id: Id) -> Self {
        Self { id, versions: None }
    }
}

impl<Id> Target<Id> {
    /// Checks the present version inside the transaction that changes it.
    ///
    /// # Errors
    /// [`StoreError::VersionDiffers`].
    pub(super) fn check(&self, version: i64) -> Result<(), StoreError> {
        match &self.versions {
            Some(accepted) if !accepted.contains(&version) => Err(StoreError::VersionDiffers),
            _ => Ok(()),
        }
    }
}
