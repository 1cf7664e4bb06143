//! A line of the file of keys: `SHA256 NAME role=ROLE [owner=OWNER] [max_requests_per_second=N] [QUOTA=N...]`.
//!
//! There is no role by default: a line that is cut, or whose role is misspelled, is refused and gives no right.

use super::quotas::{NONE, QuotaWords, Word};
use super::{ApiKey, Caller, Role, Submitter, checked_name, checked_owner, read_rate};
use crate::hex;

/// What a line may say besides digest and name.
const OPTIONS: &str = "role=, owner=, max_queued=, max_running=, max_grains=, max_stored_bytes= and \
                       max_requests_per_second=";

impl ApiKey {
    /// Reads a line. A word with an equals sign that is none of these is refused, and so is one of the name that reads
    /// like an option: a misspelled quota must not leave the key without it.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub(super) fn read(line: &str) -> Result<Self, String> {
        const FORM: &str = "must be a SHA-256 of 64 hexadecimal digits, a space and a name of its own";
        let (digest, rest) = line.split_once(char::is_whitespace).ok_or(FORM)?;
        let sha256 = hex::decode(digest).and_then(|bytes| bytes.try_into().ok()).ok_or(FORM)?;
        let words: Vec<&str> = rest.split_whitespace().collect();
        let named = words.iter().position(|word| word.contains('=')).unwrap_or(words.len());
        if let Some(word) = words[..named].iter().find(|word| reads_like_an_option(word)) {
            return Err(format!(
                "{word:?} stands in the name and reads like an option: options are {OPTIONS}"
            ));
        }
        let key = checked_name(&words[..named].join(" ")).map_err(|_| FORM)?;
        let (mut role, mut owner, mut rate) = (None, None, Word::Absent);
        let mut quotas = QuotaWords::default();
        for word in &words[named..] {
            let Some((option, value)) = word.split_once('=') else {
                return Err(format!(
                    "{word:?} stands after an option: the name must come before role= and owner="
                ));
            };
            let given_twice = match option {
                "role" => role.replace(read_role(value)?).is_some(),
                "owner" => {
                    let read = checked_owner(value).map_err(|fault| format!("owner={value}: {fault}"))?;
                    owner.replace(read).is_some()
                }
                "max_requests_per_second" => {
                    let read = Word::read(value, read_rate);
                    let read = read.map_err(|fault| format!("{word}: {fault}, or {NONE}"))?;
                    std::mem::replace(&mut rate, read) != Word::Absent
                }
                _ => match quotas.take(option, value) {
                    Some(taken) => {
                        taken?;
                        false
                    }
                    None => return Err(format!("{word:?} is unknown: a key has {OPTIONS}")),
                },
            };
            if given_twice {
                return Err(format!("{option}= is given more than once"));
            }
        }
        let role = role.ok_or("the role is missing: must be role=metrics, worker, read, submit or admin")?;
        let owner = owner.unwrap_or_else(|| key.clone());
        let caller = Caller { by: Submitter { key, owner }, role, requests_per_second: rate };
        Ok(Self { caller, quotas, sha256 })
    }
}

/// Whether a word without an equals sign was meant as an option, as `role:read` or `max_queued-5`.
fn reads_like_an_option(word: &str) -> bool {
    let word = word.to_ascii_lowercase();
    let names = ["role", "owner"].into_iter().filter_map(|name| word.strip_prefix(name));
    word.starts_with("max_")
        || names.into_iter().any(|rest| rest.starts_with([':', ';', ',', '.', '-', '_', '\'', '"']))
}

fn read_role(name: &str) -> Result<Role, String> {
    let found = Role::ALL.into_iter().find(|role| role.name() == name);
    found.ok_or_else(|| format!("role={name} is unknown: must be metrics, worker, read, submit or admin"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn read(rest: &str) -> Result<Caller, String> {
        ApiKey::read(&format!("{} {rest}", hex::sha256(b"k"))).map(|key| key.caller)
    }

    #[test]
    fn a_line_names_role_and_owner() {
        let caller = |key: &str, owner: &str, role| Caller {
            by: Submitter { key: key.into(), owner: owner.into() },
            role,
            requests_per_second: Word::Absent,
        };
        for (line, expected) in [
            ("lab role=admin", caller("lab", "lab", Role::Admin)),
            ("soil  lab role=read", caller("soil lab", "soil lab", Role::Read)),
            ("lab role=submit", caller("lab", "lab", Role::Submit)),
            ("anna owner=lab role=read", caller("anna", "lab", Role::Read)),
            ("prometheus role=metrics", caller("prometheus", "prometheus", Role::Metrics)),
            ("owner role=worker owner=max", caller("owner", "max", Role::Worker)),
        ] {
            assert_eq!(read(line), Ok(expected), "{line}");
        }
    }

    #[test]
    fn a_line_may_bound_the_requests_in_a_second() {
        let rate = |rest: &str| read(rest).map(|caller| caller.requests_per_second);
        assert_eq!(rate("lab role=read"), Ok(Word::Absent));
        assert_eq!(rate("lab role=read max_requests_per_second=0.5"), Ok(Word::Bound(0.5)));
        assert_eq!(rate("lab role=read max_requests_per_second=none"), Ok(Word::Unbounded));
        for bad in ["0", "-1", "inf", "NaN", "", "2 max_requests_per_second=2"] {
            assert!(rate(&format!("lab role=read max_requests_per_second={bad}")).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_misspelt_word_never_gives_the_default() {
        for bad in [
            "lab",
            "lab submit",
            "lab role:submit",
            "lab owner=lab",
            "lab owner:lab role=submit",
            "lab max_queued:5 role=submit",
            "lab rol=submit",
            "lab Role=submit",
            "lab role=",
            "lab role=Admin",
            "lab owner=",
            "lab role=submit role=admin",
            "lab role=submit more",
            "role=submit",
            "a=b",
            "",
        ] {
            assert!(read(bad).is_err(), "{bad}");
        }
        assert!(ApiKey::read("abc name").is_err());
        assert!(ApiKey::read(&hex::sha256(b"k")).is_err());
    }
}
