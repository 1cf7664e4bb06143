//! A connection below HTTP: for clients that stop in the middle, lie or dawdle.

use std::net::{Ipv4Addr, SocketAddr};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};

use super::deadline::patiently;

/// A connection on which a test says what it likes.
pub(crate) struct RawConnection(TcpStream);

impl RawConnection {
    pub(crate) async fn open(address: SocketAddr) -> Self {
        Self(patiently("a connection", TcpStream::connect(address)).await.expect("a connection"))
    }

    /// One from another address of this machine, as another client would have.
    pub(crate) async fn open_from(source: Ipv4Addr, address: SocketAddr) -> Self {
        let socket = TcpSocket::new_v4().expect("a socket");
        socket.bind((source, 0).into()).expect("an address of this machine");
        Self(patiently("a connection", socket.connect(address)).await.expect("a connection"))
    }

    /// Sends these bytes; a server that has closed already is no fault of the sender's.
    pub(crate) async fn send(&mut self, bytes: impl AsRef<[u8]>) {
        let _ = self.0.write_all(bytes.as_ref()).await;
    }

    /// Reads until the server closes, and returns what it said.
    pub(crate) async fn until_closed(mut self) -> String {
        let mut said = Vec::new();
        // A reset is a way to close, too.
        let _ = patiently("the server to close a connection", self.0.read_to_end(&mut said)).await;
        String::from_utf8_lossy(&said).into_owned()
    }

    /// Reads until the end of a head, and returns it with what came of the body.
    pub(crate) async fn head(&mut self) -> String {
        let mut said = Vec::new();
        patiently("the head of an answer", async {
            while !said.windows(4).any(|end| end == b"\r\n\r\n") {
                let mut block = [0; 4096];
                match self.0.read(&mut block).await {
                    Ok(n) if n > 0 => said.extend_from_slice(&block[..n]),
                    _ => break,
                }
            }
        })
        .await;
        String::from_utf8_lossy(&said).into_owned()
    }
}
