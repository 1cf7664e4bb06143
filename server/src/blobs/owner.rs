//! The mark by which a place names the database that its files belong to.
//!
//! The first service that uses a place writes the mark, under a name that is given once. A service with another
//! database is refused: to it every file there would be unknown, and would be moved to the quarantine.

use std::io::{self, Read as _, Write as _};

use serde::{Deserialize, Serialize};

use super::Blobs;

/// Name of the mark.
pub(crate) const MARK: &str = "owner.json";
/// Longest mark; a longer file is none.
const MOST_BYTES: u64 = 16 << 10;

/// A database, as a mark names it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Owner {
    /// Its identity, which a copy of the database has too.
    pub(crate) database: String,
    /// Where it lay when the mark was made, without a password: for people.
    pub(crate) store: String,
}

impl std::fmt::Display for Owner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} at {}", self.database, self.store)
    }
}

/// Why a place is not used with a database.
#[derive(Debug, thiserror::Error)]
pub(crate) enum OwnerError {
    /// It belongs to another one.
    #[error(
        "{place} belongs to the database {theirs}, as {mark} says, and not to the database {ours}: start with the \
         database that it belongs to, or name another place. If the database {theirs} is gone for good, remove {mark}"
    )]
    Other {
        /// The place.
        place: String,
        /// The mark.
        mark: String,
        /// The database that the mark names.
        theirs: Box<Owner>,
        /// The database of this service.
        ours: Box<Owner>,
    },
    /// The mark names none.
    #[error(
        "{mark} does not name the database that the place belongs to: {why}. If it is the database {ours}, remove \
         {mark}"
    )]
    Unreadable {
        /// The mark.
        mark: String,
        /// What is wrong with it.
        why: String,
        /// The database of this service.
        ours: Box<Owner>,
    },
    /// The mark cannot be read or written.
    #[error("the mark {mark}, which names the database of the place, cannot be used: {error}")]
    Io {
        /// The mark.
        mark: String,
        /// Why.
        error: io::Error,
    },
}

/// Marks a place as one of this database, or makes sure that it is. Blocks the thread.
///
/// # Errors
/// See [`OwnerError`].
pub(crate) fn claim(blobs: &dyn Blobs, ours: &Owner) -> Result<(), OwnerError> {
    match write(blobs, ours) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => check(blobs, ours),
        written => written.map_err(|error| unusable(blobs, error)),
    }
}

/// Makes sure that a place is not one of another database. Blocks the thread.
///
/// # Errors
/// See [`OwnerError`].
pub(crate) fn check(blobs: &dyn Blobs, ours: &Owner) -> Result<(), OwnerError> {
    match read(blobs) {
        Ok(theirs) if theirs.database == ours.database => Ok(()),
        Ok(theirs) => Err(OwnerError::Other {
            place: blobs.shown("").trim_end_matches('/').to_owned(),
            mark: blobs.shown(MARK),
            theirs: Box::new(theirs),
            ours: Box::new(ours.clone()),
        }),
        Err(error) if error.kind() == io::ErrorKind::InvalidData => Err(OwnerError::Unreadable {
            mark: blobs.shown(MARK),
            why: error.to_string(),
            ours: Box::new(ours.clone()),
        }),
        Err(error) => Err(unusable(blobs, error)),
    }
}

/// The database that a mark names. Blocks the thread.
///
/// # Errors
/// [`io::ErrorKind::NotFound`] without a mark, [`io::ErrorKind::InvalidData`] where it names none, or those of the
/// storage.
pub(crate) fn read(blobs: &dyn Blobs) -> io::Result<Owner> {
    // Opened where it lies: what this process may keep of it says nothing about the storage.
    let opened = blobs.open(MARK)?;
    let (length, mut text) = (opened.length()?.min(MOST_BYTES), Vec::new());
    opened.read(0..length)?.read_to_end(&mut text)?;
    serde_json::from_slice(&text)
        .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.to_string()))
}

/// Marks a place of this process alone as one of this database, whatever database it belonged to. Blocks the thread.
///
/// # Errors
/// See [`OwnerError`].
pub(crate) fn take_over(blobs: &dyn Blobs, ours: &Owner) -> Result<(), OwnerError> {
    let taken = blobs.remove(&[MARK.to_owned()]).and_then(|()| write(blobs, ours));
    taken.map_err(|error| unusable(blobs, error))
}

fn write(blobs: &dyn Blobs, owner: &Owner) -> io::Result<()> {
    let staged = blobs.stage(MARK)?;
    staged.file().write_all(&serde_json::to_vec_pretty(owner)?)?;
    blobs.publish(staged, MARK, &|| false)
}

fn unusable(blobs: &dyn Blobs, error: io::Error) -> OwnerError {
    OwnerError::Io { mark: blobs.shown(MARK), error }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::Files;
    use super::*;

    fn owner(database: &str) -> Owner {
        Owner { database: database.into(), store: format!("/srv/{database}/packstone.sqlite") }
    }

    #[test]
    fn a_place_belongs_to_the_database_that_used_it_first() {
        let folder = tempfile::tempdir().unwrap();
        let place = || Files::shared(folder.path().join("blobs")).unwrap();
        claim(&place(), &owner("first")).unwrap();
        // Another server of the same database, which may know it by another name.
        claim(&place(), &Owner { store: "elsewhere".into(), ..owner("first") }).unwrap();
        let refused = claim(&place(), &owner("second")).unwrap_err().to_string();
        for part in ["/blobs belongs to", "first at /srv/first/packstone.sqlite", "second at", "owner.json"] {
            assert!(refused.contains(part), "{refused}");
        }
        assert_eq!(read(&place()).unwrap(), owner("first"));
        take_over(&place(), &owner("second")).unwrap();
        claim(&place(), &owner("second")).unwrap();
    }

    #[test]
    fn one_of_many_databases_that_use_a_place_at_once_owns_it() {
        let folder = tempfile::tempdir().unwrap();
        let claimed: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8)
                .map(|of| {
                    let files = Files::shared(folder.path().to_owned()).unwrap();
                    scope.spawn(move || claim(&files, &owner(&of.to_string())))
                })
                .collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert_eq!(claimed.iter().filter(|claimed| claimed.is_ok()).count(), 1, "{claimed:?}");
    }

    #[test]
    fn a_mark_that_names_no_database_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let files = Files::shared(folder.path().to_owned()).unwrap();
        for text in ["", "{", "{\"database\": 1}"] {
            std::fs::write(folder.path().join(MARK), text).unwrap();
            let refused = claim(&files, &owner("first")).unwrap_err();
            assert!(matches!(refused, OwnerError::Unreadable { .. }), "{refused}");
        }
    }
}
