//! How much may be stored: the free space of the disk, a quota of the service, and a quota of each owner.
//!
//! Results, kept exports and requests count; the cache does not, for it makes way. A job is estimated before it is
//! accepted and before it runs, an export is watched while it is written.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use packstone_engine::export::tables::Column;
use packstone_engine::request::Mix;

use crate::accounts::Accounts;
use crate::disk::Disk;
use crate::jobs::JobId;
use crate::jobs::store::{Store, StoreError, StoredKind};
use crate::jobs::waiting::{WaitReason, WaitsFor};

/// Bytes of a stored result besides its grains, and of its rows in the database; more than most need.
const HEAD_BYTES: u64 = 16 << 10;

/// The bounds of the service.
#[derive(Clone, Debug)]
pub(crate) struct Storage {
    store: Store,
    disk: Disk,
    max_bytes: Option<u64>,
    accounts: Arc<Accounts>,
    /// Owners of jobs that wait because their results would not fit, and the fewest bytes that one of them needs. Kept
    /// in memory only: a restart ends all pauses.
    waiting: Arc<Mutex<BTreeMap<String, u64>>>,
}

/// More than may be stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NoRoom {
    /// Bytes that it would take at least.
    pub(crate) needed: u64,
    /// Bytes that are left.
    pub(crate) left: u64,
    /// What leaves no more.
    pub(crate) bound: Bound,
}

/// What bounds the bytes that may be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bound {
    /// The free space of the disk, of which some must stay free.
    Disk,
    /// `--max-stored-bytes`.
    Service(u64),
    /// `max_stored_bytes` of the owner, or `--max-stored-bytes-per-key`.
    Owner(u64),
}

impl std::fmt::Display for NoRoom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { needed, left, bound } = self;
        write!(f, "it needs about {needed} bytes, and {left} are left ")?;
        match bound {
            Bound::Disk => write!(f, "on the disk of the server"),
            Bound::Service(quota) => write!(f, "of the {quota} that results, exports and requests may take"),
            Bound::Owner(quota) => {
                write!(f, "of the {quota} that results, exports and requests of one owner may take")
            }
        }
    }
}

impl Storage {
    /// The bounds of a service: `max_bytes` in all, and the quotas of the owners.
    pub(crate) fn new(store: Store, disk: Disk, max_bytes: Option<u64>, accounts: Arc<Accounts>) -> Self {
        Self { store, disk, max_bytes, accounts, waiting: Arc::default() }
    }

    /// Bytes that a result of so many grains of a mix takes.
    pub(crate) fn bytes_of_result(grains: f64, mix: &Mix) -> u64 {
        let columns = Column::of(mix.grain_kind(), !mix.aggregates.is_empty());
        (grains * (columns.len() * size_of::<f64>()) as f64) as u64 + HEAD_BYTES
    }

    /// Bytes that `owner` may store, and what leaves no more.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn room(&self, owner: &str) -> Result<(u64, Bound), StoreError> {
        let mut least = (self.disk.room(), Bound::Disk);
        let max_bytes_of_owner = self.accounts.quotas(owner).stored_bytes;
        if self.max_bytes.is_none() && max_bytes_of_owner.is_none() {
            return Ok(least);
        }
        let stored = self.store.stored_bytes().await?;
        let quotas = [
            self.max_bytes.map(|quota| (quota.saturating_sub(lasting(&stored, None)), Bound::Service(quota))),
            max_bytes_of_owner
                .map(|quota| (quota.saturating_sub(lasting(&stored, Some(owner))), Bound::Owner(quota))),
        ];
        for quota in quotas.into_iter().flatten() {
            if quota.0 < least.0 {
                least = quota;
            }
        }
        Ok(least)
    }

    /// Notes that a job of this owner waits for room for so many bytes. Where there is as much room, something else
    /// kept the result from being stored, as a limit that is not counted here: then the pause of the job stays.
    pub(crate) async fn wait_for_room(&self, owner: &str, bytes: u64) {
        match self.room(owner).await {
            Ok(room) if fits(bytes, room).is_ok() => {}
            Ok(_) => self.note_waiting(owner.into(), bytes),
            Err(error) => tracing::warn!(%error, "the room is not known: a job waits until its pause ends"),
        }
    }

    /// Why a job waits whose result of so many bytes had no room.
    pub(crate) async fn why_it_waits(&self, job: JobId, bytes: u64) -> WaitReason {
        let room = async {
            let holder = self.store.holder_of_job(job).await?.ok_or(StoreError::NoJob)?;
            self.room(&holder.owner).await
        };
        let detail = match room.await.map(|room| fits(bytes, room)) {
            Ok(Err(no_room)) => format!("there is no room for its result: {no_room}"),
            // What kept it from being stored is not counted here, or has gone meanwhile.
            Ok(Ok(())) | Err(_) => format!("its result of about {bytes} bytes could not be stored"),
        };
        WaitReason { waits_for: WaitsFor::Storage, detail }
    }

    fn note_waiting(&self, owner: String, bytes: u64) {
        self.waiting().entry(owner).and_modify(|least| *least = bytes.min(*least)).or_insert(bytes);
    }

    /// Ends the pauses of the jobs of each owner for whose smallest waiting result there is room. Those that still do
    /// not fit are noted again, for more room than there is: so each change of the room costs them one try. While jobs
    /// wait for the disk, the space of the write-ahead log of the database is given back.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn start_what_fits(&self) -> Result<(), StoreError> {
        let waiting = self.waiting().clone();
        let mut is_disk_short = false;
        for (owner, bytes) in waiting {
            if let Err(no_room) = fits(bytes, self.room(&owner).await?) {
                is_disk_short |= no_room.bound == Bound::Disk;
                continue;
            }
            // Before the jobs may start: what is noted from now on stays.
            self.waiting().remove(&owner);
            match self.store.end_pauses(owner.clone()).await {
                Ok(jobs) => tracing::info!(jobs, owner, "there is room again: jobs wait no longer"),
                Err(error) => {
                    self.note_waiting(owner, bytes);
                    return Err(error);
                }
            }
        }
        if is_disk_short {
            self.store.shrink_log().await;
        }
        Ok(())
    }

    /// One who panicked cannot have left it half-changed.
    fn waiting(&self) -> MutexGuard<'_, BTreeMap<String, u64>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bytes that the cache may hold beside what is stored, at most `most`.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn cache_bytes(&self, most: u64) -> Result<u64, StoreError> {
        let Some(quota) = self.max_bytes else { return Ok(most) };
        let stored = self.store.stored_bytes().await?;
        Ok(most.min(quota.saturating_sub(lasting(&stored, None))))
    }
}

/// Bytes of results and kept exports, of all keys or of one.
fn lasting(stored: &BTreeMap<(String, StoredKind), u64>, owner: Option<&str>) -> u64 {
    let counts = |(key, kind): &(String, StoredKind)| {
        *kind != StoredKind::Cache && owner.is_none_or(|owner| owner == key)
    };
    stored.iter().filter(|(key, _)| counts(key)).map(|(_, bytes)| *bytes).sum()
}

/// Refuses what is larger than the room.
///
/// # Errors
/// [`NoRoom`].
pub(crate) fn fits(needed: u64, (left, bound): (u64, Bound)) -> Result<(), NoRoom> {
    if needed > left { Err(NoRoom { needed, left, bound }) } else { Ok(()) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::time::Duration;

    use serde_json::json;

    use super::*;
    use crate::accounts::Submitter;
    use crate::disk::Shortage;
    use crate::jobs::JobRequest;
    use crate::jobs::store::{NewJob, StoreLimits};

    /// A job that is queued, and met a fault at its first attempt.
    async fn paused(store: &Store) {
        let request = json!({
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
        });
        let new = NewJob {
            request: JobRequest::read(&request, 1, None).unwrap(),
            warnings: Vec::new(),
            forecast_s: 1.0,
            keeps_checkpoints: true,
            most_threads: 1,
            by: Submitter::default(),
            idempotency_key: None,
        };
        store.submit(new).await.unwrap();
        let lease = store.claim().await.unwrap().unwrap().lease;
        assert_eq!(store.requeue_after_fault(lease, WaitReason::machine()).await.unwrap(), "");
        assert!(store.claim().await.unwrap().is_none(), "it waits");
    }

    #[tokio::test]
    async fn a_pause_ends_as_soon_as_there_is_room_and_no_pause_but_for_room() {
        let folder = tempfile::tempdir().unwrap();
        let limits = StoreLimits { max_queued: 10, lease: Duration::from_mins(1) };
        let store =
            Store::open(&folder.path().join("db").as_path().into(), folder.path(), limits, Arc::default())
                .await
                .unwrap();
        let disk = Disk::new(folder.path().into(), Some(0), Shortage::default());
        paused(&store).await;
        let requests: u64 = store.stored_bytes().await.unwrap().values().sum();
        let mut storage = Storage::new(store.clone(), disk, Some(requests + 1000), Arc::default());
        // Something else than the room kept its result from being stored.
        storage.wait_for_room("", 1000).await;
        storage.start_what_fits().await.unwrap();
        assert!(store.claim().await.unwrap().is_none());
        storage.wait_for_room("", 2000).await;
        storage.wait_for_room("", 1500).await;
        storage.wait_for_room("other", 1001).await;
        storage.start_what_fits().await.unwrap();
        assert!(store.claim().await.unwrap().is_none());
        storage.max_bytes = Some(requests + 1499);
        storage.start_what_fits().await.unwrap();
        assert!(store.claim().await.unwrap().is_none(), "for another owner there is room");
        storage.max_bytes = Some(requests + 1500);
        storage.start_what_fits().await.unwrap();
        let lease = store.claim().await.unwrap().unwrap().lease;
        // What was noted is forgotten.
        store.requeue_after_fault(lease, WaitReason::machine()).await.unwrap();
        storage.start_what_fits().await.unwrap();
        assert!(store.claim().await.unwrap().is_none());
    }

    #[test]
    fn a_refusal_has_the_figures() {
        assert_eq!(fits(10, (10, Bound::Disk)), Ok(()));
        let refused = fits(11, (10, Bound::Owner(40))).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "it needs about 11 bytes, and 10 are left of the 40 that results, exports and requests of one owner \
             may take"
        );
    }

    #[test]
    fn a_result_has_the_columns_of_its_grains() {
        let ellipsoid =
            json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}});
        for (shape, columns) in [(json!({"type": "sphere"}), 4), (ellipsoid, 12)] {
            let request = json!({
                "specimen": {"type": "box", "size_mm": [50, 50, 50]},
                "mix": {
                    "grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2, "shape": shape
                }
            });
            let mix = JobRequest::read(&request, 1, None).unwrap().packing().mix;
            assert_eq!(Storage::bytes_of_result(1e6, &mix), columns * 8_000_000 + HEAD_BYTES);
        }
    }
}
