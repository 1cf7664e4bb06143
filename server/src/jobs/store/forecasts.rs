//! The forecast of a job: the time that its plan expects it to take on one core, stored at its submission. Triggers
//! keep the sums of the jobs that wait and run (`migrations/`).

use std::time::Duration;

use super::db::query;
use super::{Store, StoreError, micros, rows};
use crate::jobs::State;
use crate::jobs::request::MAX_TIMEOUT_S;

/// Stands for the forecast of a job that has none: one of an earlier version, or one whose plan tells no time. The
/// default of the column is the same.
pub(crate) const UNKNOWN_FORECAST: Duration = Duration::from_mins(1);

/// The least time of a worker for a job that is forecast to take longer, and whose method keeps checkpoints.
pub(crate) const LEAST_TIME: Duration = Duration::from_secs(30);

/// The forecasts of all jobs in a state, added up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ForecastWork {
    /// Of the jobs that wait, in s on one core.
    pub(crate) queued_s: f64,
    /// Of the jobs that run, in s on one core; of each the whole, however much of it is done.
    pub(crate) running_s: f64,
}

/// The forecast as it is stored, in µs: that of the plan, in s, bounded by the time limit of the job.
pub(super) fn micros_of(forecast_s: f64, timeout_s: Option<f64>) -> i64 {
    let most_s = timeout_s.map_or(MAX_TIMEOUT_S, |timeout_s| timeout_s.min(MAX_TIMEOUT_S));
    let known_s = if forecast_s >= 0.0 { forecast_s } else { UNKNOWN_FORECAST.as_secs_f64() };
    micros(Duration::from_secs_f64(known_s.min(most_s).max(0.0)))
}

/// The least time that a worker must have left to be given a job with this forecast, in µs.
///
/// A job whose method keeps checkpoints comes further in any time and goes on elsewhere, so that half a minute is
/// enough, which is longer than handing it on takes. Another one would lose all its work where it is cut.
pub(super) fn least_time_us(forecast_us: i64, keeps_checkpoints: bool) -> i64 {
    if keeps_checkpoints { forecast_us.min(micros(LEAST_TIME)) } else { forecast_us }
}

impl Store {
    /// The forecast work of the jobs that wait and run.
    pub(crate) async fn forecast_work(&self) -> Result<ForecastWork, StoreError> {
        let mut work = ForecastWork::default();
        for row in query("select state, forecast_us from job_counts").fetch_all(self.readers()).await? {
            let work_s = row.try_get::<i64>("forecast_us")? as f64 / 1e6;
            match rows::state(row.text("state")?)? {
                State::Queued => work.queued_s = work_s,
                State::Running => work.running_s = work_s,
                _ => {}
            }
        }
        Ok(work)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::super::tests::{fresh, submit_forecast, succeed};
    use super::*;
    use crate::jobs::WaitReason;

    fn work(queued_s: f64, running_s: f64) -> ForecastWork {
        ForecastWork { queued_s, running_s }
    }

    #[test]
    fn a_forecast_is_bounded_by_the_time_limit_and_defaults_to_a_minute() {
        for (forecast_s, timeout_s, us) in [
            (2.5, None, 2_500_000),
            (0.0, None, 0),
            (90.0, Some(10.0), 10_000_000),
            (f64::INFINITY, Some(0.5), 500_000),
            (f64::INFINITY, None, 2_678_400_000_000),
            (f64::NAN, None, 60_000_000),
            (f64::NAN, Some(5.0), 5_000_000),
        ] {
            assert_eq!(micros_of(forecast_s, timeout_s), us, "{forecast_s} {timeout_s:?}");
        }
    }

    /// The sums by trigger, which must be those of the rows.
    async fn work_of(store: &Store) -> ForecastWork {
        let mut of_rows = ForecastWork::default();
        for (state, work_s) in [("queued", &mut of_rows.queued_s), ("running", &mut of_rows.running_s)] {
            let sum = query("select cast(coalesce(sum(forecast_us), 0) as bigint) from jobs where state = ?");
            let us: i64 = sum.bind(state).scalar(store.readers()).await.unwrap();
            *work_s = us as f64 / 1e6;
        }
        let work = store.forecast_work().await.unwrap();
        assert_eq!(work, of_rows);
        work
    }

    #[tokio::test]
    async fn the_work_follows_every_transition() {
        let (_folder, store) = fresh().await;
        assert_eq!(work_of(&store).await, work(0.0, 0.0));
        let first = submit_forecast(&store, 100.0, json!({})).await;
        let second = submit_forecast(&store, 20.0, json!({"timeout_s": 8})).await;
        submit_forecast(&store, f64::NAN, json!({"priority": -1})).await;
        assert_eq!(work_of(&store).await, work(168.0, 0.0));
        let lease = store.claim().await.unwrap().unwrap().lease;
        assert_eq!(work_of(&store).await, work(68.0, 100.0));
        store.give_back(lease).await.unwrap();
        assert_eq!(work_of(&store).await, work(168.0, 0.0));
        let lease = store.claim().await.unwrap().unwrap().lease;
        assert_eq!(lease.id, first.id);
        store.requeue_after_fault(lease, WaitReason::machine()).await.unwrap();
        assert_eq!(work_of(&store).await, work(168.0, 0.0));
        let lease = store.claim().await.unwrap().unwrap().lease;
        assert_eq!(lease.id, second.id);
        succeed(&store, lease).await;
        assert_eq!(work_of(&store).await, work(160.0, 0.0));
        store.cancel(first.id).await.unwrap();
        assert_eq!(work_of(&store).await, work(60.0, 0.0));
        store.retry(first.id, None).await.unwrap();
        assert_eq!(work_of(&store).await, work(160.0, 0.0));
        let lease = store.claim().await.unwrap().unwrap().lease;
        assert_eq!(lease.id, first.id);
        assert_eq!(work_of(&store).await, work(60.0, 100.0));
        assert_eq!(store.recover(Vec::new()).await.unwrap(), 1);
        assert_eq!(work_of(&store).await, work(160.0, 0.0));
        store.cancel(first.id).await.unwrap();
        store.delete(first.id).await.unwrap();
        store.delete(second.id).await.unwrap();
        assert_eq!(work_of(&store).await, work(60.0, 0.0));
    }
}
