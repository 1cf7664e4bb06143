//! Blobs as objects in a bucket of S3, by the crate `object_store`.
//!
//! A blob is staged in a folder on this machine and uploaded when it is published: up to 16 MiB in one request that
//! fails where the name exists (`If-None-Match: *`), above in parts of 8 MiB, which are seen together or not at all.
//! The interface of the crate completes parts whatever is there, so that the name is looked for just before: two
//! processes that complete one name at the same moment would not notice, and a name belongs to one attempt of one
//! process. Parts are given up where the process lives; those of one that was killed go by a rule of the bucket.
//!
//! Requests are tried three times within 20 s. What fails then is a fault of the machine, which passes.

mod connector;
mod copies;
mod requests;

use std::error::Error as _;
use std::fs::{self, File};
use std::io::{self, Read};
use std::ops::Range;
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use futures_util::stream::{self, BoxStream, StreamExt as _, TryStreamExt as _};
use hyper::Method;
use object_store::aws::{AmazonS3, AmazonS3Builder};
use object_store::path::Path;
use object_store::signer::{SignedUrlOptions, Signer as _};
use object_store::{
    BackoffConfig, Error, GetOptions, GetRange, MultipartUpload, ObjectStore as _, ObjectStoreExt as _,
    PutMode, PutPayload, RetryConfig,
};
use tokio::time::{sleep, timeout};
use uuid::Uuid;

use self::connector::Connector;
use self::copies::Copies;
use self::requests::Requests;
use super::{Blob, Blobs, Listed, PARTIAL, Shown, Staged};
use crate::disk::Disk;

/// Longest blob that is sent in one request.
const WHOLE_BYTES: u64 = 16 << 20;
/// Length of the parts of a longer one.
const PART_BYTES: u64 = 8 << 20;
/// Parts that are sent at once, and are in memory meanwhile.
const PARTS_AT_ONCE: usize = 2;
/// Requests are repeated so often, and none is begun later than this after the first.
const RETRIES: RetryConfig = RetryConfig {
    backoff: BackoffConfig {
        init_backoff: Duration::from_millis(200),
        max_backoff: Duration::from_secs(5),
        base: 3.0,
    },
    max_retries: 2,
    retry_timeout: Duration::from_secs(20),
};
/// Longest wait for the next bytes of an object, and for an answer without a body, all tries included.
const ANSWER: Duration = Duration::from_mins(1);
/// Time between two looks whether an upload is to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Name of an object that is written to learn the time.
const CLOCK: &str = "clock";

/// Objects of a bucket whose names begin with a prefix.
#[derive(Debug)]
pub(crate) struct Objects {
    store: Arc<AmazonS3>,
    bucket: String,
    prefix: String,
    scratch: PathBuf,
    copies: Copies,
    requests: Arc<Requests>,
}

impl Objects {
    /// A bucket of S3, with credentials and endpoint from the variables `AWS_*` of the environment. Files that are on
    /// their way to it and copies of objects lie in the folder `scratch`, within the room of its disk. Blocks the
    /// thread.
    ///
    /// # Errors
    /// The settings are wrong, or the bucket does not answer or refuses.
    pub(crate) fn s3(bucket: &str, prefix: &str, scratch: PathBuf, disk: Disk) -> io::Result<Self> {
        Self::open(AmazonS3Builder::from_env(), bucket, prefix, scratch, disk)
    }

    pub(super) fn open(
        settings: AmazonS3Builder,
        bucket: &str,
        prefix: &str,
        scratch: PathBuf,
        disk: Disk,
    ) -> io::Result<Self> {
        let store = settings
            .with_bucket_name(bucket)
            .with_http_connector(Connector)
            .with_retry(RETRIES)
            .build()
            .map_err(|error| of_storage(&error))?;
        let objects = Self {
            store: Arc::new(store),
            bucket: bucket.to_owned(),
            prefix: prefix.to_owned(),
            copies: Copies::new(scratch.clone(), disk),
            scratch,
            requests: Arc::new(Requests::new()?),
        };
        // One page: that the bucket is there and lets itself be read.
        let first = objects
            .wait(async { objects.store.list(objects.below("").as_ref()).next().await.transpose() })?;
        tracing::debug!(empty = first.is_none(), bucket, prefix, "the bucket answers");
        Ok(objects)
    }

    fn path(&self, name: &str) -> Path {
        Path::from(format!("{}/{name}", self.prefix))
    }

    /// What a listing of a folder is asked for.
    fn below(&self, folder: &str) -> Option<Path> {
        let path = self.path(folder);
        (!path.as_ref().is_empty()).then_some(path)
    }

    /// Waits for the end of a request.
    fn wait<T>(&self, request: impl Future<Output = Result<T, Error>>) -> io::Result<T> {
        self.requests
            .wait(async { timeout(ANSWER, request).await })
            .map_err(|_| late())?
            .map_err(|error| of_storage(&error))
    }

    /// Uploads a file in one request.
    async fn put_whole(&self, path: &Path, file: &File, length: u64) -> io::Result<()> {
        let payload = PutPayload::from_bytes(read_part(file, 0..length)?);
        self.store
            .put_opts(path, payload, PutMode::Create.into())
            .await
            .map_err(|error| of_storage(&error))?;
        Ok(())
    }

    /// Uploads a file in parts; those of a failed upload are given up by the caller.
    async fn put_parts(
        &self,
        upload: &mut dyn MultipartUpload,
        path: &Path,
        file: &File,
        length: u64,
    ) -> io::Result<()> {
        let starts: Vec<u64> = (0..length).step_by(PART_BYTES as usize).collect();
        let parts = starts.into_iter().map(|start| {
            let part = read_part(file, start..length.min(start + PART_BYTES))?;
            Ok(upload.put_part(PutPayload::from_bytes(part)))
        });
        stream::iter(parts)
            .map_ok(|part| async { part.await.map_err(|error| of_storage(&error)) })
            .try_buffer_unordered(PARTS_AT_ONCE)
            .try_collect::<()>()
            .await?;
        if self.exists(path).await? {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        upload.complete().await.map_err(|error| of_storage(&error))?;
        Ok(())
    }

    async fn exists(&self, path: &Path) -> io::Result<bool> {
        match self.store.head(path).await {
            Ok(_) => Ok(true),
            Err(Error::NotFound { .. }) => Ok(false),
            Err(error) => Err(of_storage(&error)),
        }
    }

    /// The length of an object. An answer without a body does not tell a missing object from a missing bucket.
    async fn length(&self, path: &Path) -> Result<u64, Error> {
        match self.store.head(path).await {
            Err(missing @ Error::NotFound { .. }) => {
                self.store.list(Some(path)).next().await.transpose()?;
                Err(missing)
            }
            found => Ok(found?.size),
        }
    }
}

impl Blobs for Objects {
    fn stage(&self, _name: &str) -> io::Result<Staged> {
        fs::create_dir_all(&self.scratch)?;
        Staged::create(self.scratch.join(format!("{}{PARTIAL}", Uuid::now_v7().simple())))
    }

    fn publish(&self, staged: Staged, name: &str, is_stopped: &dyn Fn() -> bool) -> io::Result<()> {
        let length = staged.file().metadata()?.len();
        let path = self.path(name);
        self.requests.wait(async {
            if length <= WHOLE_BYTES {
                return unless(is_stopped, self.put_whole(&path, staged.file(), length)).await;
            }
            let begun = async { self.store.put_multipart(&path).await.map_err(|error| of_storage(&error)) };
            let mut upload = unless(is_stopped, begun).await?;
            let put = unless(is_stopped, self.put_parts(&mut *upload, &path, staged.file(), length)).await;
            if put.is_err()
                && let Err(error) = timeout(ANSWER, upload.abort()).await.unwrap_or(Ok(()))
            {
                tracing::warn!(%error, name, "parts of an upload are left to the rule of the bucket");
            }
            put
        })
    }

    fn fetch(&self, name: &str) -> io::Result<File> {
        if let Some(kept) = self.copies.open(name) {
            return Ok(kept);
        }
        let path = self.path(name);
        let length = self.wait(self.length(&path))?;
        let copy = |mut file: &File| {
            if length > 0 {
                io::copy(&mut read(&self.store, &self.requests, &path, 0..length)?, &mut file)?;
            }
            Ok(())
        };
        self.copies.make(name, length, copy)
    }

    fn forget(&self, name: &str) {
        self.copies.forget(name);
    }

    fn is_remote(&self) -> bool {
        true
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn Blob>> {
        let path = self.path(name);
        let length = self.wait(self.length(&path))?;
        let (store, requests) = (Arc::clone(&self.store), Arc::clone(&self.requests));
        let objects = Opened { store, path, length, requests };
        Ok(Box::new(objects))
    }

    fn url(&self, name: &str, shown: &Shown<'_>, valid: Duration) -> io::Result<Option<String>> {
        let query = [
            ("response-content-type", shown.content_type),
            ("response-content-disposition", shown.disposition),
        ];
        let options = SignedUrlOptions::new().with_query(query);
        let path = self.path(name);
        let url = self.wait(self.store.signed_url_opts(Method::GET, &path, valid, &options))?;
        Ok(Some(url.into()))
    }

    fn remove(&self, names: &[String]) -> io::Result<()> {
        for name in names {
            self.copies.forget(name);
        }
        // One is removed by a request that every store has.
        if let [name] = names {
            return match self.wait(self.store.delete(&self.path(name))) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
                removed => removed,
            };
        }
        let paths: Vec<_> = names.iter().map(|name| Ok(self.path(name))).collect();
        let mut removed = self.store.delete_stream(stream::iter(paths).boxed());
        while let Some(result) = self.wait(async { Ok(removed.next().await) })? {
            match result {
                Ok(_) | Err(Error::NotFound { .. }) => {}
                Err(error) => return Err(of_storage(&error)),
            }
        }
        Ok(())
    }

    fn remove_folder(&self, folder: &str) -> io::Result<()> {
        let names: Vec<String> = self.list(folder)?.into_iter().map(|listed| listed.name).collect();
        if names.is_empty() { Ok(()) } else { self.remove(&names) }
    }

    fn rename(&self, from: &str, to: &str) -> io::Result<bool> {
        match self.wait(self.store.copy(&self.path(from), &self.path(to))) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
            copied => copied?,
        }
        self.remove(&[from.to_owned()])?;
        Ok(true)
    }

    fn list(&self, folder: &str) -> io::Result<Vec<Listed>> {
        let mut listed = self.store.list(self.below(folder).as_ref());
        let mut found = Vec::new();
        while let Some(object) = self.wait(listed.try_next())? {
            let Some(name) = object.location.as_ref().strip_prefix(&self.prefix) else { continue };
            let name = name.trim_start_matches('/').to_owned();
            found.push(Listed { name, written: Some(object.last_modified.into()) });
        }
        Ok(found)
    }

    fn is_shared(&self) -> bool {
        true
    }

    fn now(&self) -> io::Result<SystemTime> {
        let path = self.path(CLOCK);
        let written = async {
            self.store.put(&path, PutPayload::from_static(b"now")).await?;
            self.store.head(&path).await
        };
        Ok(self.wait(written)?.last_modified.into())
    }

    fn shown(&self, name: &str) -> String {
        format!("s3://{}/{}", self.bucket, self.path(name))
    }
}

/// An object that is to be sent as it lies.
#[derive(Debug)]
struct Opened {
    store: Arc<AmazonS3>,
    path: Path,
    length: u64,
    requests: Arc<Requests>,
}

impl Blob for Opened {
    fn length(&self) -> io::Result<u64> {
        Ok(self.length)
    }

    fn read(self: Box<Self>, range: Range<u64>) -> io::Result<Box<dyn Read + Send>> {
        if range.is_empty() {
            return Ok(Box::new(io::empty()));
        }
        Ok(Box::new(read(&self.store, &self.requests, &self.path, range)?))
    }
}

/// Starts to read a part of an object, of at least one byte.
fn read(store: &AmazonS3, requests: &Arc<Requests>, path: &Path, range: Range<u64>) -> io::Result<Reading> {
    let options = GetOptions::new().with_range(Some(GetRange::Bounded(range)));
    let found = requests.wait(async { timeout(ANSWER, store.get_opts(path, options)).await });
    let blocks = found.map_err(|_| late())?.map_err(|error| of_storage(&error))?.into_stream();
    Ok(Reading { blocks, block: Bytes::new(), requests: Arc::clone(requests) })
}

/// Bytes of an object as they come.
struct Reading {
    blocks: BoxStream<'static, Result<Bytes, Error>>,
    block: Bytes,
    requests: Arc<Requests>,
}

impl Read for Reading {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while self.block.is_empty() {
            let next = self.requests.wait(async { timeout(ANSWER, self.blocks.next()).await });
            let Some(block) = next.map_err(|_| late())? else { return Ok(0) };
            self.block = block.map_err(|error| of_storage(&error))?;
        }
        let taken = self.block.split_to(into.len().min(self.block.len()));
        into[..taken.len()].copy_from_slice(&taken);
        Ok(taken.len())
    }
}

fn read_part(file: &File, range: Range<u64>) -> io::Result<Bytes> {
    let mut part = vec![0; (range.end - range.start) as usize];
    file.read_exact_at(&mut part, range.start)?;
    Ok(part.into())
}

/// Waits for the end of something, or until it is to stop.
async fn unless<T>(
    is_stopped: &dyn Fn() -> bool,
    work: impl Future<Output = io::Result<T>>,
) -> io::Result<T> {
    tokio::pin!(work);
    while !is_stopped() {
        tokio::select! {
            done = &mut work => return done,
            () = sleep(LOOK_EVERY) => {}
        }
    }
    Err(io::ErrorKind::ConnectionAborted.into())
}

fn late() -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, "the bucket does not answer")
}

/// What an error of the crate is to the rest of the server. All but a missing object and a name that is taken pass.
fn of_storage(error: &Error) -> io::Error {
    let told = |error: &Error| {
        let mut text = error.to_string();
        let mut source = error.source();
        while let Some(below) = source {
            let below_text = below.to_string();
            if !text.contains(&below_text) {
                text = format!("{text}: {below_text}");
            }
            source = below.source();
        }
        text
    };
    let text = told(error);
    let kind = match error {
        Error::NotFound { .. } if !text.contains("NoSuchBucket") => io::ErrorKind::NotFound,
        Error::AlreadyExists { .. } => io::ErrorKind::AlreadyExists,
        _ => io::ErrorKind::Other,
    };
    io::Error::new(kind, text)
}
