//! The gallery, `examples/gallery`: every request is packed, every README has the command that packs it, and
//! `docs/gallery.md` lists every folder.

use std::fs;
use std::path::Path;

use crate::harness::packstone;

#[tokio::test]
async fn every_request_of_the_gallery_is_packed_and_listed() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let page = fs::read_to_string(root.join("docs/gallery.md")).unwrap();
    let (directory, mut count) = (tempfile::tempdir().unwrap(), 0);
    for entry in fs::read_dir(root.join("examples/gallery")).unwrap() {
        let folder = entry.unwrap().path();
        let name = folder.file_name().unwrap().to_str().unwrap();
        assert!(page.contains(&format!("](../examples/gallery/{name})")), "docs/gallery.md lacks {name}");
        assert!(fs::metadata(folder.join("thumb.png")).unwrap().len() < 100_000, "{name}");
        let readme = fs::read_to_string(folder.join("README.md")).unwrap();
        let command =
            format!("\npackstone run examples/gallery/{name}/request.json --out {name} --picture\n");
        assert!(readme.contains(&command), "{readme}");
        let request = folder.join("request.json").canonicalize().unwrap();
        let ended = packstone(directory.path(), &["run", request.to_str().unwrap(), "--out", name]).await;
        assert_eq!(ended.code, Some(0), "{name}: {ended:?}");
        count += 1;
    }
    assert!(count >= 24, "{count}");
}

#[tokio::test]
async fn an_example_is_packed_by_its_name_alone() {
    let directory = tempfile::tempdir().unwrap();
    for again in [false, true] {
        let more: &[&str] = if again { &["--force"] } else { &[] };
        let ended = packstone(directory.path(), &[&["run", "--example", "air-voids"], more].concat()).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        for file in ["request.json", "result.json", "result.png"] {
            assert!(directory.path().join("air-voids").join(file).exists(), "{file}");
        }
    }
    let ended =
        packstone(directory.path(), &["run", "--example", "dice", "--out", "mine", "--format", "csv"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(directory.path().join("mine/result.csv").exists() && !directory.path().join("dice").exists());
    for wrong in [&["run", "--example", "dices"][..], &["run", "--example", "dice", "job.json"], &["run"]] {
        assert_eq!(packstone(directory.path(), wrong).await.code, Some(2), "{wrong:?}");
    }
}
