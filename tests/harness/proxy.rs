//! A proxy between a server and its storage that can be told to fail.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, copy_bidirectional};
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
                let fault = *present.lock().unwrap();
                let (target, count) = (target.clone(), Arc::clone(&count));
                tokio::spawn(async move { pass(stream, fault, &target, &count).await });
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

async fn pass(mut stream: TcpStream, fault: Fault, target: &str, failed: &watch::Sender<usize>) {
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
                let _ = copy_bidirectional(&mut stream, &mut upstream).await;
            }
        }
    }
}

async fn hold(failed: &watch::Sender<usize>) {
    failed.send_modify(|count| *count += 1);
    std::future::pending::<()>().await;
}
