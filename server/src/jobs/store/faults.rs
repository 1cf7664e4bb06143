//! Which errors of the database are faults of the machine, which pass, and not of the program.

use super::{StoreError, Unusable};

/// A fault of the machine that the database met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The file system is full.
    NoSpace,
    /// Another program holds a lock on the database.
    Locked,
    /// All connections to the database were in use by other requests for as long as one is waited for.
    Busy,
    /// No memory is left.
    NoMemory,
    /// A file could not be opened, read or written: no descriptors, a failing disk, a read-only file system.
    Io,
    /// Pages of the database are not what was written, or the file is none.
    Damaged,
}

/// The fault behind an error of the database; `None` where the program is at fault.
pub(super) fn fault_of(error: &sqlx::Error) -> Option<Fault> {
    match error {
        sqlx::Error::Database(error)
            if error.try_downcast_ref::<sqlx::postgres::PgDatabaseError>().is_some() =>
        {
            by_sqlstate(&error.code()?)
        }
        sqlx::Error::Database(error) => by_code(error.code()?.parse().ok()?),
        sqlx::Error::Io(error) if crate::disk::is_full(error) => Some(Fault::NoSpace),
        sqlx::Error::PoolTimedOut => Some(Fault::Busy),
        sqlx::Error::Configuration(why) if why.is::<Unusable>() => Some(Fault::Io),
        // What is left of a transaction that SQLite rolled back by itself; see `writer`.
        sqlx::Error::Io(_)
        | sqlx::Error::WorkerCrashed
        | sqlx::Error::BeginFailed
        | sqlx::Error::InvalidSavePointStatement => Some(Fault::Io),
        _ => None,
    }
}

/// By SQLite's result code (<https://sqlite.org/rescode.html>); an extended code has the primary one in its last byte.
fn by_code(code: i32) -> Option<Fault> {
    /// `SQLITE_IOERR_SHMSIZE`: the shared memory file could not grow.
    const SHMSIZE: i32 = 4874;
    match (code, code & 0xff) {
        (SHMSIZE, _) | (_, 13) => Some(Fault::NoSpace),
        (_, 5 | 6 | 15) => Some(Fault::Locked),
        (_, 7) => Some(Fault::NoMemory),
        (_, 8 | 10 | 14) => Some(Fault::Io),
        (_, 11 | 26) => Some(Fault::Damaged),
        _ => None,
    }
}

/// By the SQLSTATE of PostgreSQL (<https://www.postgresql.org/docs/current/errcodes-appendix.html>).
fn by_sqlstate(code: &str) -> Option<Fault> {
    match code {
        "53100" => Some(Fault::NoSpace),
        "53200" => Some(Fault::NoMemory),
        // A lock was not to be had, or a transaction had to give way.
        "55P03" | "40001" | "40P01" => Some(Fault::Locked),
        // Too many connections, the database stops or starts, it ended a connection that said nothing, an error of
        // input or output, a lost connection, a server that lets nobody write.
        "53300" | "57P01" | "57P02" | "57P03" | "57P05" | "25P03" | "58030" | "25006" => Some(Fault::Io),
        _ if code.starts_with("08") => Some(Fault::Io),
        "XX001" | "XX002" => Some(Fault::Damaged),
        _ => None,
    }
}

impl StoreError {
    /// The fault of the machine behind it, if it is one.
    pub(crate) fn fault(&self) -> Option<Fault> {
        match self {
            Self::Database(error) => fault_of(error),
            Self::Unusable(_) => Some(Fault::Io),
            _ => None,
        }
    }

    /// Whether the file system is full.
    pub(crate) fn is_full(&self) -> bool {
        self.fault() == Some(Fault::NoSpace)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sqlstates_tell_faults_of_the_machine_from_others() {
        for (code, fault) in [
            ("53100", Some(Fault::NoSpace)),
            ("57P01", Some(Fault::Io)),
            ("25P03", Some(Fault::Io)),
            ("08006", Some(Fault::Io)),
            ("40P01", Some(Fault::Locked)),
            ("XX001", Some(Fault::Damaged)),
            ("23505", None),
            ("42601", None),
        ] {
            assert_eq!(by_sqlstate(code), fault, "{code}");
        }
    }

    #[test]
    fn a_pool_without_a_free_connection_is_no_fault_of_a_file() {
        assert_eq!(fault_of(&sqlx::Error::PoolTimedOut), Some(Fault::Busy));
    }

    #[test]
    fn result_codes_tell_faults_of_the_machine_from_others() {
        for (code, fault) in [
            (13, Some(Fault::NoSpace)),
            (4874, Some(Fault::NoSpace)),
            (5, Some(Fault::Locked)),
            (517, Some(Fault::Locked)),
            (7, Some(Fault::NoMemory)),
            (14, Some(Fault::Io)),
            (778, Some(Fault::Io)),
            (11, Some(Fault::Damaged)),
            (267, Some(Fault::Damaged)),
            (26, Some(Fault::Damaged)),
            (1, None),
            (787, None),
        ] {
            assert_eq!(by_code(code), fault, "{code}");
        }
    }
}
