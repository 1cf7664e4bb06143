//! Results as files of the web: `ETag`, ranges, conditions, HEAD (RFC 9110 sections 8.8, 13 and 14).

use std::io::Read as _;

use bytes::Bytes;
use flate2::read::GzDecoder;

use crate::harness::{Client, DataDir, Reply, Server, id_of, jobs};

struct Stored {
    client: Client,
    path: String,
    whole: Bytes,
    etag: String,
}

impl Stored {
    async fn in_format(client: &Client, id: &str, format: &str) -> Self {
        let path = format!("/v1/jobs/{id}/result?format={format}");
        let reply = client.get(&path).send().await;
        let etag = reply.expect(200).header("etag").to_owned();
        assert!(etag.starts_with('"') && etag.len() > 2, "{etag} is not a strong validator");
        assert_eq!(reply.header("accept-ranges"), "bytes");
        Self { client: client.clone(), path, whole: reply.body, etag }
    }

    async fn get(&self, headers: &[(&str, &str)]) -> Reply {
        let mut request = self.client.get(&self.path);
        for (name, value) in headers {
            request = request.header(name, value);
        }
        request.send().await
    }
}

#[tokio::test]
async fn any_part_of_any_format_can_be_fetched() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(20_000, 1)).await;
    for format in ["json", "csv", "vtk", "vtp", "npy"] {
        let stored = Stored::in_format(&client, id_of(&job), format).await;
        let n = stored.whole.len();
        assert!(n > 300_000, "{format} is too short to cross the blocks of the stream");
        for (range, from, to) in [
            ("bytes=0-0".to_owned(), 0, 1),
            ("bytes=0-99".to_owned(), 0, 100),
            (format!("bytes=131071-{}", 2 * 131_072), 131_071, 2 * 131_072 + 1),
            (format!("bytes={}-", n - 1), n - 1, n),
            ("bytes=-1000".to_owned(), n - 1000, n),
            (format!("bytes=-{}", 10 * n), 0, n),
            (format!("bytes=100-{}", 10 * n), 100, n),
        ] {
            let reply = stored.get(&[("range", &range)]).await;
            reply.expect(206);
            assert!(reply.body[..] == stored.whole[from..to], "{format} {range} are other bytes");
            assert_eq!(reply.header("content-range"), format!("bytes {from}-{}/{n}", to - 1));
            assert_eq!(reply.header("content-length"), (to - from).to_string());
            assert_eq!(reply.header("etag"), stored.etag);
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn text_is_compressed_for_those_who_take_it() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(20_000, 1)).await;
    let gzip = ("accept-encoding", "gzip, br");
    for format in ["json", "csv"] {
        let stored = Stored::in_format(&client, id_of(&job), format).await;
        let vary = client.get(&stored.path).send().await.header("vary").to_owned();
        assert_eq!(vary, "accept, accept-encoding");

        let zipped = stored.get(&[gzip]).await;
        assert_eq!(zipped.expect(200).header("content-encoding"), "gzip");
        for (name, value) in [("vary", vary.as_str()), ("accept-ranges", "none")] {
            assert_eq!(zipped.header(name), value, "{format}");
        }
        assert!(zipped.headers.get("content-length").is_none(), "its length is not known before its end");
        assert!(
            5 * zipped.body.len() < 4 * stored.whole.len(),
            "{} of {}",
            zipped.body.len(),
            stored.whole.len()
        );
        let mut read = Vec::new();
        GzDecoder::new(&zipped.body[..]).read_to_end(&mut read).expect("gzip");
        assert!(read == stored.whole, "{format}");

        // Each form has its tag, by which it is known.
        let etag = zipped.header("etag").to_owned();
        assert!(etag.starts_with('"') && etag != stored.etag, "{etag}");
        assert_eq!(stored.get(&[gzip, ("if-none-match", &etag)]).await.expect(304).header("etag"), etag);
        stored.get(&[gzip, ("if-none-match", &stored.etag)]).await.expect(200);
        stored.get(&[("if-none-match", &etag)]).await.expect(200);

        // A range is one of the plain bytes, and none of those that were compressed.
        let part = stored.get(&[gzip, ("range", "bytes=5-99")]).await;
        assert!(part.expect(206).body == stored.whole[5..100]);
        assert!(part.headers.get("content-encoding").is_none());
        assert_eq!(part.header("etag"), stored.etag);
        let resumed = stored.get(&[gzip, ("range", "bytes=5-99"), ("if-range", &etag)]).await;
        assert!(resumed.expect(200).body == stored.whole);

        let head = client.head(&stored.path).header(gzip.0, gzip.1).send().await;
        assert!(head.expect(200).body.is_empty() && head.headers.get("content-length").is_none());
        for name in
            ["content-encoding", "etag", "vary", "accept-ranges", "content-type", "content-disposition"]
        {
            assert_eq!(head.header(name), zipped.header(name), "{name}");
        }
        let refused = stored.get(&[("accept-encoding", "gzip;q=0, br")]).await;
        assert!(refused.expect(200).headers.get("content-encoding").is_none());
    }
    for format in ["npy", "vtp"] {
        let stored = Stored::in_format(&client, id_of(&job), format).await;
        let reply = stored.get(&[gzip]).await;
        assert!(reply.expect(200).body == stored.whole && reply.headers.get("content-encoding").is_none());
        assert_eq!((reply.header("vary"), reply.header("etag")), ("accept", &*stored.etag));
    }
    server.stop().await;
}

#[tokio::test]
async fn what_is_no_range_is_ignored_and_what_lies_beyond_is_refused() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let stored = Stored::in_format(&client, id_of(&job), "csv").await;
    let n = stored.whole.len();

    for beyond in [
        format!("bytes={n}-"),
        format!("bytes={n}-{}", n + 5),
        "bytes=-0".to_owned(),
        format!("bytes={}-", u64::MAX),
    ] {
        let reply = stored.get(&[("range", &beyond)]).await;
        let problem = reply.expect_problem(416, "range-not-satisfiable");
        assert_eq!(reply.header("content-range"), format!("bytes */{n}"), "{beyond}");
        assert!(problem["detail"].as_str().unwrap().contains(&n.to_string()), "{problem:#}");
    }
    // RFC 9110 section 14.2: a range that is not understood is as none.
    for nonsense in ["bytes=5-2", "bytes=a-b", "rows=0-9", "bytes", "bytes=", "bytes=--5", "bytes=1-2-3"] {
        let reply = stored.get(&[("range", nonsense)]).await;
        assert!(reply.expect(200).body == stored.whole, "{nonsense}");
    }
    let several = stored.get(&[("range", "bytes=0-1,5-6")]).await;
    assert!(several.expect(200).body == stored.whole);
    server.stop().await;
}

#[tokio::test]
async fn conditions_are_honoured() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let csv = Stored::in_format(&client, id_of(&job), "csv").await;
    let npy = Stored::in_format(&client, id_of(&job), "npy").await;
    assert_ne!(csv.etag, npy.etag, "two forms of a result are two things");

    for matching in
        [csv.etag.clone(), format!("\"x\", {}", csv.etag), "*".to_owned(), format!("W/{}", csv.etag)]
    {
        let reply = csv.get(&[("if-none-match", &matching)]).await;
        assert!(reply.expect(304).body.is_empty());
        assert_eq!(reply.header("etag"), csv.etag);
    }
    csv.get(&[("if-none-match", &npy.etag)]).await.expect(200);

    // A download is resumed only if it is still the same thing.
    csv.get(&[("range", "bytes=0-9"), ("if-range", &csv.etag)]).await.expect(206);
    for other in [npy.etag.as_str(), "\"x\"", &format!("W/{}", csv.etag), "Sat, 21 Nov 2026 00:00:00 GMT"] {
        let reply = csv.get(&[("range", "bytes=0-9"), ("if-range", other)]).await;
        assert!(reply.expect(200).body == csv.whole, "{other}");
    }
    let beyond = format!("bytes={}-", csv.whole.len());
    csv.get(&[("range", &beyond), ("if-range", &npy.etag)]).await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn head_answers_as_get_does_without_a_body() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let stored = Stored::in_format(&client, id_of(&job), "vtp").await;
    let head = client.head(&stored.path).send().await;
    assert!(head.expect(200).body.is_empty());
    for name in ["content-type", "etag", "content-disposition", "accept-ranges"] {
        let get = stored.get(&[]).await;
        assert_eq!(head.header(name), get.header(name), "{name}");
    }
    assert_eq!(head.header("content-length"), stored.whole.len().to_string());

    for path in [format!("/v1/jobs/{}", id_of(&job)), "/v1/jobs".into(), "/v1/capabilities".into()] {
        let (head, get) = (client.head(&path).send().await, client.get(&path).send().await);
        assert_eq!((head.status, head.header("content-type")), (get.status, get.header("content-type")));
        assert!(head.body.is_empty());
    }
    client.head("/v1/jobs/none").send().await.expect(404);
    server.stop().await;
}

#[tokio::test]
async fn the_same_bytes_come_after_a_restart() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let job = server.client().succeed(&jobs::quick(1)).await;
    let before = Stored::in_format(&server.client(), id_of(&job), "json").await;
    server.stop().await;
    let server = Server::start(&data_dir).await;
    let after = Stored::in_format(&server.client(), id_of(&job), "json").await;
    assert_eq!(after.etag, before.etag);
    assert!(after.whole == before.whole);
    server.stop().await;
}
