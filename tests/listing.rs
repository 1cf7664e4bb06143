//! Lists of jobs: filters, and pages that neither lose nor repeat a job while others come in.

use std::collections::HashSet;

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, Server, id_of, jobs};

async fn page(client: &Client, query: &str) -> Value {
    client.get(&format!("/v1/jobs{query}")).send().await.expect(200).json()
}

fn ids(page: &Value) -> Vec<String> {
    page["items"].as_array().unwrap().iter().map(|job| id_of(job).to_owned()).collect()
}

/// All pages of a query, of `limit` jobs each.
async fn all(client: &Client, filter: &str, limit: usize) -> Vec<String> {
    let (mut found, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = page(client, &format!("?limit={limit}{filter}{cursor}")).await;
        let ids = ids(&page);
        assert!(ids.len() <= limit);
        found.extend(ids);
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return found,
        }
    }
}

#[tokio::test]
async fn pages_join_to_the_whole_list() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mut submitted = Vec::new();
    for seed in 0..25 {
        submitted.push(id_of(&client.submit(&jobs::quick(seed)).await).to_owned());
    }
    let whole = ids(&page(&client, "?limit=100").await);
    assert_eq!(whole.len(), 25);
    let newest_first: Vec<_> = submitted.iter().rev().cloned().collect();
    assert!(whole == submitted || whole == newest_first, "jobs are listed in the order of submission");
    for limit in [1, 7, 24, 25, 26] {
        assert_eq!(all(&client, "", limit).await, whole, "pages of {limit}");
    }

    let first = client.get("/v1/jobs?limit=10").send().await;
    let link = first.header("link");
    let target = link.split(['<', '>']).nth(1).expect("a target").to_owned();
    assert!(link.contains("rel=\"next\""), "{link}");
    let by_link = client.get(&target).send().await.expect(200).json();
    assert_eq!(ids(&by_link), whole[10..20]);
    let last = client.get("/v1/jobs?limit=100").send().await;
    assert!(last.headers.get("link").is_none() && last.json()["next_cursor"].is_null());
    server.stop().await;
}

#[tokio::test]
async fn filters_by_state_and_labels() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let labelled = |seed, series: &str, day: &str| {
        jobs::with(jobs::quick(seed), "/labels", json!({"series": series, "day": day}))
    };
    let a = client.succeed(&labelled(1, "TB-7", "1")).await;
    let b = client.succeed(&labelled(2, "TB-7", "2")).await;
    let c = client.succeed(&labelled(3, "TB/8:x y", "1")).await;
    let failed = client.submit(&jobs::unreachable()).await;
    client.finished(id_of(&failed)).await;
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    let queued = client.submit(&labelled(4, "TB-7", "1")).await;

    let sorted = |mut ids: Vec<String>| {
        ids.sort();
        ids
    };
    let of = |jobs: &[&Value]| sorted(jobs.iter().map(|job| id_of(job).to_owned()).collect());
    for (query, expected) in [
        ("&state=succeeded", of(&[&a, &b, &c])),
        ("&state=failed", of(&[&failed])),
        ("&state=running", of(&[&running])),
        ("&state=queued", of(&[&queued])),
        ("&state=cancelled", of(&[])),
        ("&label=series=TB-7", of(&[&a, &b, &queued])),
        ("&label=series=TB-7&label=day=1", of(&[&a, &queued])),
        ("&label=series=TB-7&label=day=1&state=succeeded", of(&[&a])),
        ("&label=series=TB%2F8%3Ax%20y", of(&[&c])),
        ("&label=series=absent", of(&[])),
    ] {
        for limit in [1, 100] {
            assert_eq!(sorted(all(&client, query, limit).await), expected, "{query}");
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn jobs_are_sorted_by_priority_and_by_end_over_all_pages() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    // Ends come in the order of priority, but for the job that comes first.
    let blocker = client.submit(&jobs::endless()).await;
    client.running(id_of(&blocker)).await;
    let mut waiting = Vec::new();
    for (seed, priority) in [5, -3, 0, 5, 0, 0, -3, 100, 5].into_iter().enumerate() {
        let job = jobs::with(jobs::quick(seed as u64), "/priority", json!(priority));
        let job = jobs::with(job, "/labels", json!({"parity": (seed % 2).to_string()}));
        waiting.push((priority, id_of(&client.submit(&job).await).to_owned()));
    }
    let mut expected = vec![(0, id_of(&blocker).to_owned())];
    expected.extend(waiting.iter().cloned());
    // Stable: equal jobs stay in the order of submission.
    expected.sort_by_key(|(priority, _)| *priority);
    let by_priority: Vec<String> = expected.into_iter().map(|(_, id)| id).collect();
    let reversed = |ids: &[String]| ids.iter().rev().cloned().collect::<Vec<_>>();
    for limit in [1, 2, 3, 4, 9, 10, 100] {
        assert_eq!(all(&client, "&sort=priority", limit).await, by_priority, "pages of {limit}");
        assert_eq!(all(&client, "&sort=-priority", limit).await, reversed(&by_priority), "pages of {limit}");
    }
    let queued = all(&client, "&sort=priority&state=queued", 2).await;
    let all_queued: Vec<_> = by_priority.iter().filter(|id| *id != id_of(&blocker)).cloned().collect();
    assert_eq!(queued, all_queued);
    let odd: HashSet<&String> =
        waiting.iter().enumerate().filter(|(i, _)| i % 2 == 1).map(|(_, (_, id))| id).collect();
    let all_odd: Vec<_> = by_priority.iter().filter(|id| odd.contains(id)).cloned().collect();
    assert_eq!(all(&client, "&sort=priority&label=parity=1", 1).await, all_odd);

    // None has ended: all are equal, in the order of submission.
    let submitted = all(&client, "&sort=created", 100).await;
    assert_eq!(all(&client, "&sort=finished", 3).await, submitted);
    assert_eq!(all(&client, "&sort=-finished", 3).await, reversed(&submitted));
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&blocker))).send().await;
    let mut ends = Vec::new();
    for id in &submitted {
        let ended = client.finished(id).await;
        ends.push((ended["finished_at"].as_str().unwrap().to_owned(), id.clone()));
    }
    let held = client.submit(&jobs::endless()).await;
    client.running(id_of(&held)).await;
    ends.sort();
    let mut by_end = vec![id_of(&held).to_owned()];
    by_end.extend(ends.into_iter().map(|(_, id)| id));
    assert_eq!(by_end[1], id_of(&blocker));
    for limit in [1, 4, 11, 100] {
        assert_eq!(all(&client, "&sort=finished", limit).await, by_end, "pages of {limit}");
        assert_eq!(all(&client, "&sort=-finished", limit).await, reversed(&by_end), "pages of {limit}");
    }
    assert_eq!(all(&client, "&sort=-finished&state=succeeded", 2).await, reversed(&by_end[2..]));

    // The link keeps the order, and a cursor is one of its order only.
    let first = client.get("/v1/jobs?sort=-finished&limit=4").send().await;
    let target = first.header("link").split(['<', '>']).nth(1).expect("a target").to_owned();
    assert_eq!(ids(&client.get(&target).send().await.expect(200).json()), reversed(&by_end)[4..8]);
    let cursor = first.json()["next_cursor"].as_str().unwrap().to_owned();
    let other = client.get(&format!("/v1/jobs?sort=finished&limit=4&cursor={cursor}")).send().await;
    let problem = other.expect_problem(400, "validation-error");
    assert_eq!(problem["errors"][0]["parameter"], "cursor");
    server.stop().await;
}

#[tokio::test]
async fn pages_lose_and_repeat_nothing_while_jobs_come_in() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let blocker = client.submit(&jobs::endless()).await;
    client.running(id_of(&blocker)).await;
    let mut before = HashSet::new();
    for seed in 0..40 {
        before.insert(id_of(&client.submit(&jobs::quick(seed)).await).to_owned());
    }
    let writer = client.clone();
    let inserting = tokio::spawn(async move {
        for seed in 100..200 {
            writer.submit(&jobs::quick(seed)).await;
        }
    });
    let mut rounds = 0;
    while rounds < 3 || !inserting.is_finished() {
        let found = all(&client, "&state=queued", 3).await;
        let unique: HashSet<_> = found.iter().cloned().collect();
        assert_eq!(unique.len(), found.len(), "a job was listed twice");
        assert!(before.is_subset(&unique), "a job was lost between two pages");
        rounds += 1;
    }
    inserting.await.unwrap();
    assert_eq!(all(&client, "&state=queued", 50).await.len(), 140);
    server.stop().await;
}

#[tokio::test]
async fn what_is_no_query_is_refused_by_name() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for (query, parameter, detail) in [
        ("state=done", "state", "done"),
        ("limit=0", "limit", "0"),
        ("limit=-1", "limit", "-1"),
        ("limit=ten", "limit", "ten"),
        ("limit=100000", "limit", "100000"),
        ("cursor=nowhere", "cursor", "nowhere"),
        ("cursor=", "cursor", ""),
        ("label=", "label", ""),
        ("label=series", "label", "series"),
        ("colour=red", "colour", "unknown"),
        ("limit=1&limit=2", "limit", ""),
    ] {
        let problem =
            client.get(&format!("/v1/jobs?{query}")).send().await.expect_problem(400, "validation-error");
        assert_eq!(problem["errors"][0]["parameter"], parameter, "{query}: {problem:#}");
        let said = problem["errors"][0]["detail"].as_str().unwrap();
        assert!(said.contains(detail), "{query}: {said}");
    }
    server.stop().await;
}
