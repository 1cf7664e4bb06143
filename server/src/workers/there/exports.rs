//! Exports that this process makes for a server: the result that one is made from, which is fetched, and its end.

use std::time::Duration;

use hyper::StatusCode;
use serde_json::Value;

use super::{ServerError, There, address};
use crate::exports::ExportLease;
use crate::exports::making::{MadeExport, Work};
use crate::failure::{Failure, FailureCode};
use crate::workers::documents::{EndOutcome, EndRequest};
use crate::workers::ending::{Cause, Told};
use crate::workers::task::LeaseError;

impl There {
    /// Fetches the result that an export is made from. Without it the export goes back to the queue.
    pub(crate) async fn fetch_result(&self, work: &Work) {
        let fetched = async {
            let mut file = self.shared.artifacts.fetching(&work.result.path)?;
            let path = address(work.lease, "result");
            self.shared.server.get_file(&path, |piece| file.write(piece)).await?;
            Ok::<_, ServerError>(file.finish()?)
        };
        if let Err(error) = fetched.await {
            tracing::warn!(%error, "the result was not fetched");
        }
    }

    /// Sends an export, or the end of its run; the lease ends with it.
    ///
    /// # Errors
    /// [`LeaseError`].
    pub(crate) async fn end_export(
        &self,
        lease: ExportLease,
        told: Told<'_, MadeExport>,
    ) -> Result<(), LeaseError> {
        let sent = self.send_export(lease, told).await;
        self.ended(lease.into(), sent)
    }

    async fn send_export(&self, lease: ExportLease, told: Told<'_, MadeExport>) -> Result<(), ServerError> {
        let (outcome, failure) = match told {
            Told::Succeeded(made) => {
                let file = self.shared.artifacts.open_file(&made.file.path)?;
                let report = serde_json::to_vec(&made.report).map_err(std::io::Error::from)?;
                let (sha256, report_bytes) = (&made.file.sha256, report.len());
                let path =
                    format!("{}?sha256={sha256}&report_bytes={report_bytes}", address(lease, "export"));
                match self.shared.server.put_file(&path, report, file).await {
                    // As where the server makes it itself.
                    Err(ServerError::Refused {
                        status: StatusCode::INSUFFICIENT_STORAGE, detail, ..
                    }) => (EndOutcome::Failed, Some(Failure::new(FailureCode::InsufficientStorage, detail))),
                    sent => return sent,
                }
            }
            Told::Failed(failure, _) => (EndOutcome::Failed, Some(failure)),
            Told::Released => {
                self.send_last_checkpoint(lease).await?;
                (EndOutcome::Released, None)
            }
            Told::Faulted(cause) => {
                let failure = (cause == Cause::NoMemory)
                    .then(|| Failure::new(FailureCode::OutOfMemory, "the worker found no memory"));
                (EndOutcome::Faulted, failure)
            }
            Told::Cancelled | Told::Nothing => return Err(ServerError::lost()),
        };
        let end = EndRequest { outcome, failure, facts: None, needed_bytes: None };
        self.shared.server.post::<Value>(&address(lease, "end"), &end, Duration::ZERO).await?;
        Ok(())
    }
}
