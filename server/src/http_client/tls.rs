//! TLS of the client, by rustls with the certificate authorities of the system (or of `SSL_CERT_FILE`).

use std::io;
use std::sync::{Arc, OnceLock};

use tokio::net::TcpStream;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};
use tokio_rustls::{TlsConnector, rustls};

/// Begins TLS on a connection; the certificate must be one of the host.
pub(super) async fn secure(stream: TcpStream, host: &str) -> io::Result<TlsStream<TcpStream>> {
    let name = ServerName::try_from(host.to_owned())
        .map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error))?;
    connector(configuration()?).connect(name, stream).await
}

fn connector(configuration: Arc<ClientConfig>) -> TlsConnector {
    TlsConnector::from(configuration)
}

/// Read once: a hundred files.
fn configuration() -> io::Result<Arc<ClientConfig>> {
    static READ: OnceLock<Arc<ClientConfig>> = OnceLock::new();
    if let Some(read) = READ.get() {
        return Ok(Arc::clone(read));
    }
    let found = rustls_native_certs::load_native_certs();
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(found.certs);
    if roots.is_empty() {
        let why = found.errors.first().map(|error| format!(": {error}")).unwrap_or_default();
        let text = format!("the system has no certificate authorities (Debian: ca-certificates){why}");
        return Err(io::Error::new(io::ErrorKind::NotFound, text));
    }
    let built = with_roots(roots)?;
    Ok(Arc::clone(READ.get_or_init(|| built)))
}

fn with_roots(roots: RootCertStore) -> io::Result<Arc<ClientConfig>> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(io::Error::other)?;
    Ok(Arc::new(builder.with_root_certificates(roots).with_no_client_auth()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::TcpListener;
    use tokio_rustls::TlsAcceptor;
    use tokio_rustls::rustls::ServerConfig;
    use tokio_rustls::rustls::pki_types::pem::PemObject as _;
    use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};

    use super::*;

    /// A certificate of `lab.example` that signs itself, until 2126.
    const CERTIFICATE: &[u8] = include_bytes!("../../../tests/data/tls/certificate.pem");
    const KEY: &[u8] = include_bytes!("../../../tests/data/tls/key.pem");

    #[tokio::test]
    async fn a_certificate_is_demanded_of_the_host_that_was_named() {
        let certificate = CertificateDer::from_pem_slice(CERTIFICATE).unwrap();
        let mut roots = RootCertStore::empty();
        roots.add(certificate.clone()).unwrap();
        let trusting = connector(with_roots(roots).unwrap());
        let strict = connector(with_roots(RootCertStore::empty()).unwrap());
        let server = ServerConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(vec![certificate], PrivateKeyDer::from_pem_slice(KEY).unwrap())
            .unwrap();
        let acceptor = TlsAcceptor::from(Arc::new(server));
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(async move {
            loop {
                let (stream, _) = listener.accept().await.unwrap();
                if let Ok(mut stream) = acceptor.accept(stream).await {
                    stream.write_all(b"ok").await.unwrap();
                    stream.shutdown().await.unwrap();
                }
            }
        });
        let ask = async |connector: &TlsConnector, host: &'static str| {
            let stream = TcpStream::connect(address).await.unwrap();
            let mut stream = connector.connect(ServerName::try_from(host).unwrap(), stream).await?;
            let mut text = String::new();
            stream.read_to_string(&mut text).await?;
            Ok::<_, io::Error>(text)
        };
        assert_eq!(ask(&trusting, "lab.example").await.unwrap(), "ok");
        assert!(ask(&trusting, "other.example").await.is_err(), "a certificate of another host");
        assert!(ask(&strict, "lab.example").await.is_err(), "a certificate that nobody has signed");
    }
}
