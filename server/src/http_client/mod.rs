//! A client of HTTP/1.1: one connection per request, or connections that are kept ([`Kept`]), with TLS where the URL
//! says `https`.
//!
//! The name of a host is resolved apart from the connection, so that a caller can check the addresses first and then
//! connect to one that it has checked. Proxies are not used, redirects are not followed, and limits of time are the
//! caller's.

mod kept;
mod tls;

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use axum::body::Body;
use hyper::body::Incoming;
use hyper::client::conn::http1::SendRequest;
use hyper::rt::{Read, Write};
use hyper::{Request, Response, Uri, header};
use hyper_util::rt::TokioIo;
use tokio::net::TcpStream;

pub(crate) use kept::Kept;

/// A connection that requests are sent over, one after the other.
type Connection = SendRequest<Body>;

/// Time for a connection, its TLS included.
const CONNECT: Duration = Duration::from_secs(10);

/// Why there is no response.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ClientError {
    /// No address, no connection, or one that broke off.
    #[error(transparent)]
    Connection(#[from] io::Error),
    /// The other side does not speak HTTP/1.1, or stopped to.
    #[error("the exchange failed: {0}")]
    Exchange(#[from] hyper::Error),
    /// The request is none.
    #[error("the request is invalid: {0}")]
    Request(#[from] axum::http::Error),
}

/// Where requests go: scheme, host and port of a URL.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Origin {
    https: bool,
    /// A name, or an address without brackets.
    host: String,
    port: u16,
}

impl Origin {
    /// The origin of a URL.
    ///
    /// # Errors
    /// What is wrong with it, in one sentence.
    pub(crate) fn of(url: &Uri) -> Result<Self, &'static str> {
        let https = match url.scheme_str() {
            Some("http") => false,
            Some("https") => true,
            _ => return Err("must begin with http:// or https://"),
        };
        if url.authority().is_some_and(|authority| authority.as_str().contains('@')) {
            return Err("must have no user or password");
        }
        let host = url.host().unwrap_or_default().trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() {
            return Err("must name a host");
        }
        let port = url.port_u16().unwrap_or(if https { 443 } else { 80 });
        Ok(Self { https, host: host.to_owned(), port })
    }

    /// A service without TLS at an address.
    pub(crate) fn at(address: SocketAddr) -> Self {
        Self { https: false, host: address.ip().to_string(), port: address.port() }
    }

    /// The addresses of the host, as the system resolves its name.
    ///
    /// # Errors
    /// The system's, where the name has no address among others.
    pub(crate) async fn addresses(&self) -> io::Result<Vec<SocketAddr>> {
        let found: Vec<_> = tokio::net::lookup_host((self.host.as_str(), self.port)).await?.collect();
        if found.is_empty() {
            let text = format!("the name {:?} has no address", self.host);
            return Err(io::Error::new(io::ErrorKind::NotFound, text));
        }
        Ok(found)
    }

    /// Connects to the first address of the host that answers, and sends a request there.
    ///
    /// # Errors
    /// See [`ClientError`]; that of the last address where none answers.
    pub(crate) async fn send(&self, request: Request<Body>) -> Result<Response<Incoming>, ClientError> {
        self.exchange(self.connect().await?, request).await
    }

    /// Connects to one address, which the caller has chosen, and sends a request there.
    ///
    /// # Errors
    /// See [`ClientError`].
    pub(crate) async fn send_to(
        &self,
        address: SocketAddr,
        request: Request<Body>,
    ) -> Result<Response<Incoming>, ClientError> {
        self.exchange(self.open(connect(address).await?).await?, request).await
    }

    /// Connects to the first address of the host that answers.
    async fn connect(&self) -> Result<Connection, ClientError> {
        let mut addresses = self.addresses().await?.into_iter();
        let mut connected = Err(io::ErrorKind::NotFound.into());
        while connected.is_err()
            && let Some(address) = addresses.next()
        {
            connected = connect(address).await;
        }
        self.open(connected?).await
    }

    /// Speaks HTTP over a stream, within TLS where the origin says so.
    async fn open(&self, stream: TcpStream) -> Result<Connection, ClientError> {
        if !self.https {
            return handshake(TokioIo::new(stream)).await;
        }
        {
            let secured = tokio::time::timeout(CONNECT, tls::secure(stream, &self.host));
            let secured = secured.await.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
            handshake(TokioIo::new(secured?)).await
        }
    }

    /// Sends a request whose URI is a path; `Host` is set here. The connection ends with the response.
    async fn exchange(
        &self,
        mut connection: Connection,
        mut request: Request<Body>,
    ) -> Result<Response<Incoming>, ClientError> {
        self.set_host(&mut request)?;
        Ok(connection.send_request(request).await?)
    }

    fn set_host(&self, request: &mut Request<Body>) -> Result<(), ClientError> {
        let host = self.to_string().parse().map_err(axum::http::Error::from)?;
        request.headers_mut().insert(header::HOST, host);
        Ok(())
    }
}

async fn handshake(stream: impl Read + Write + Unpin + Send + 'static) -> Result<Connection, ClientError> {
    let (connection, exchanges) = hyper::client::conn::http1::handshake(stream).await?;
    // It ends when nobody holds the connection and the last response was read; what goes wrong with it is told by the
    // response.
    tokio::spawn(exchanges);
    Ok(connection)
}

/// As `Host` has it.
impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.host.contains(':') {
            write!(f, "[{}]", self.host)?;
        } else {
            f.write_str(&self.host)?;
        }
        if self.port != if self.https { 443 } else { 80 } {
            write!(f, ":{}", self.port)?;
        }
        Ok(())
    }
}

async fn connect(address: SocketAddr) -> io::Result<TcpStream> {
    let connected = tokio::time::timeout(CONNECT, TcpStream::connect(address)).await;
    let stream = connected.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()))?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_origin_is_scheme_host_and_port() {
        let origin = |url: &str| url.parse::<Uri>().map_err(|_| "no URL").and_then(|url| Origin::of(&url));
        for (url, host, shown) in [
            ("http://lab.example/hook?x=1", "lab.example", "lab.example"),
            ("https://lab.example:8443/", "lab.example", "lab.example:8443"),
            ("https://[::1]/", "::1", "[::1]"),
            ("http://127.0.0.1:8080", "127.0.0.1", "127.0.0.1:8080"),
        ] {
            let found = origin(url).unwrap();
            assert_eq!((found.host.as_str(), found.to_string().as_str()), (host, shown));
        }
        for bad in ["lab.example", "/hook", "ftp://lab.example/", "http://a:b@lab.example/", "http://"] {
            assert!(origin(bad).is_err(), "{bad}");
        }
    }
}
