//! A proxy between a server and its storage that can be told to fail.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{ReadHalf, WriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

/// What becomes of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// It is passed on.
    None,
    /// It is answered with 503.
    Unavailable,
    /// Its connection is closed.
    Closed,
    /// It is held for ever.
    Held,
    /// Those that write are held for ever, and only their first bytes are read.
    HeldWrites,
    /// It is passed on, but its answer is held for ever.
    HeldAnswers,
}

/// Passes on requests, one for each connection.
pub(crate) struct Proxy {
    address: SocketAddr,
    fault: Arc<Mutex<Fault>>,
    failed: watch::Receiver<usize>,
}

impl Proxy {
    /// Listens for requests to `target`, host and port.
    pub(crate) async fn start(target: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let fault = Arc::new(Mutex::new(Fault::None));
        let (count, failed) = watch::channel(0);
        let (present, target) = (Arc::clone(&fault), target.to_owned());
        tokio::spawn(async move {
            let count = Arc::new(count);
            while let Ok((stream, _)) = listener.accept().await {
                let (target, count, present) = (target.clone(), Arc::clone(&count), Arc::clone(&present));
                tokio::spawn(async move { pass(stream, &present, &target, &count).await });
            }
        });
        Self { address, fault, failed }
    }

    /// Where it listens, as a URL.
    pub(crate) fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// What becomes of the requests from now on.
    pub(crate) fn set(&self, fault: Fault) {
        *self.fault.lock().unwrap() = fault;
    }

    /// Waits until so many requests have failed, or are held.
    pub(crate) async fn has_failed(&self, times: usize) {
        let mut failed = self.failed.clone();
        super::deadline::patiently("requests to fail", failed.wait_for(|count| *count >= times))
            .await
            .unwrap();
    }
}

async fn pass(mut stream: TcpStream, present: &Mutex<Fault>, target: &str, failed: &watch::Sender<usize>) {
    let fault = *present.lock().unwrap();
    let fail = || failed.send_modify(|count| *count += 1);
    let mut first = [0; 4];
    if fault == Fault::Closed || stream.read_exact(&mut first).await.is_err() {
        return fail();
    }
    match fault {
        Fault::Unavailable => {
            fail();
            // All of it is read: an answer before that may be lost with the connection.
            let answer =
                b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 0\r\n\r\n";
            let _ = stream.write_all(answer).await;
            let _ = stream.shutdown().await;
            let _ = tokio::io::copy(&mut stream, &mut tokio::io::sink()).await;
        }
        Fault::Held => hold(failed).await,
        Fault::HeldWrites if first == *b"PUT " => hold(failed).await,
        _ => {
            let Ok(mut upstream) = TcpStream::connect(target).await else { return };
            if upstream.write_all(&first).await.is_ok() {
                let (mut from_client, to_client) = stream.split();
                let (from_server, mut to_server) = upstream.split();
                tokio::select! {
                    _ = tokio::io::copy(&mut from_client, &mut to_server) => {}
                    () = answer(from_server, to_client, present, failed) => {}
                }
            }
        }
    }
}

/// Passes on answers until the server closes the connection.
async fn answer(
    mut from_server: ReadHalf<'_>,
    mut to_client: WriteHalf<'_>,
    present: &Mutex<Fault>,
    failed: &watch::Sender<usize>,
) {
    let mut buffer = vec![0; 1 << 16];
    while let Ok(length @ 1..) = from_server.read(&mut buffer).await {
        if *present.lock().unwrap() == Fault::HeldAnswers {
            hold(failed).await;
        }
        if to_client.write_all(&buffer[..length]).await.is_err() {
            return;
        }
    }
}

async fn hold(failed: &watch::Sender<usize>) {
    failed.send_modify(|count| *count += 1);
    std::future::pending::<()>().await;
}
