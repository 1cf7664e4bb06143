//! A bucket of S3 on this machine, for one test: the server of `moto`, a package of Python, run by `moto_server.py`.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};

use super::machine;

/// What the bucket is called.
const BUCKET: &str = "packstone";

/// The server and its bucket. Dropped, it is killed.
pub(crate) struct Bucket {
    server: Child,
    address: String,
    http: reqwest::Client,
}

impl Bucket {
    /// Starts one. Returns `None` where `PACKSTONE_PYTHON` names no Python, after it said so.
    pub(crate) async fn start() -> Option<Self> {
        let python = machine::python("No bucket of S3 was tested.")?;
        let mut server = Command::new(python)
            .args(["-c", include_str!("moto_server.py")])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the Python of PACKSTONE_PYTHON");
        let mut said = BufReader::new(server.stderr.take().expect("a pipe")).lines().map_while(Result::ok);
        let mut lines = Vec::new();
        let address = said.by_ref().find_map(|line| {
            let address = line.split_once("http://").map(|(_, address)| address.trim().to_owned());
            lines.push(line);
            address
        });
        let address = address.unwrap_or_else(|| panic!("moto does not start: {}", lines.join("\n")));
        // Its pipe must not fill.
        std::thread::spawn(move || said.for_each(drop));
        let http = reqwest::Client::builder().no_proxy().build().expect("a client");
        let bucket = Self { server, address, http };
        let made = bucket.http.put(format!("{}/{BUCKET}", bucket.endpoint())).send().await;
        assert!(made.expect("an answer of moto").status().is_success());
        Some(bucket)
    }

    /// Where it listens, as a URL.
    pub(crate) fn endpoint(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Host and port of where it listens.
    pub(crate) fn address(&self) -> &str {
        &self.address
    }

    /// What `--blobs` names it by, with a prefix.
    pub(crate) fn url(prefix: &str) -> String {
        format!("s3://{BUCKET}/{prefix}")
    }

    /// The variables of the environment by which its users reach it at `endpoint`.
    pub(crate) fn variables(endpoint: &str) -> [(&'static str, String); 5] {
        [
            ("AWS_ENDPOINT_URL", endpoint.to_owned()),
            ("AWS_ALLOW_HTTP", "true".into()),
            ("AWS_ACCESS_KEY_ID", "test".into()),
            ("AWS_SECRET_ACCESS_KEY", "test-secret".into()),
            ("AWS_REGION", "us-east-1".into()),
        ]
    }

    /// The names of all objects.
    pub(crate) async fn objects(&self) -> Vec<String> {
        self.named("list-type=2", "Key").await
    }

    /// The names of the objects that are being uploaded in parts.
    pub(crate) async fn uploads(&self) -> Vec<String> {
        self.named("uploads", "Key").await
    }

    async fn named(&self, query: &str, element: &str) -> Vec<String> {
        let url = format!("{}/{BUCKET}?{query}", self.endpoint());
        let text =
            self.http.get(url).send().await.expect("an answer of moto").text().await.expect("its body");
        let opening = format!("<{element}>");
        let parts = text.split(opening.as_str()).skip(1);
        parts.filter_map(|part| part.split_once("</")).map(|(name, _)| name.to_owned()).collect()
    }

    /// Makes an object.
    pub(crate) async fn put(&self, name: &str, bytes: Vec<u8>) {
        let url = format!("{}/{BUCKET}/{name}", self.endpoint());
        done(self.http.put(url).body(bytes)).await;
    }

    /// Removes an object.
    pub(crate) async fn delete(&self, name: &str) {
        let url = format!("{}/{BUCKET}/{name}", self.endpoint());
        done(self.http.delete(url)).await;
    }
}

async fn done(request: reqwest::RequestBuilder) {
    // Moto reads whose request it is, and checks no signature.
    let credential = "AWS4-HMAC-SHA256 Credential=test/20260101/us-east-1/s3/aws4_request, SignedHeaders=host, Signature=0";
    let answer = request.header("authorization", credential).send().await.expect("an answer of moto");
    let status = answer.status();
    assert!(status.is_success(), "{status}: {}", answer.text().await.expect("its body"));
}

impl Drop for Bucket {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}
