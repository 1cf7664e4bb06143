//! Every fault of a job that a person can make is named with its place, its value and its bound.

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, Server, jobs};

/// One fault: what is written where, and what the answer must say about it.
struct Case {
    job: Value,
    kind: &'static str,
    pointer: &'static str,
    says: &'static [&'static str],
}

/// A job with another value at a place, refused as `validation-error` at that place.
fn case(pointer: &'static str, value: Value, says: &'static [&'static str]) -> Case {
    at(pointer, value, pointer, says)
}

/// The same, where the fault is reported at another place than that of the change.
fn at(changed: &str, value: Value, pointer: &'static str, says: &'static [&'static str]) -> Case {
    Case { job: jobs::with(jobs::quick(1), changed, value), kind: "validation-error", pointer, says }
}

fn of_kind(kind: &'static str, case: Case) -> Case {
    Case { kind, ..case }
}

fn unknown_and_missing() -> Vec<Case> {
    let without = |parent: &str, field: &str, pointer| {
        let mut job = jobs::quick(1);
        job.pointer_mut(parent).unwrap().as_object_mut().unwrap().remove(field);
        Case { job, kind: "validation-error", pointer, says: &["missing", "required"] }
    };
    vec![
        case("/colour", json!("red"), &["unknown field", "specimen", "mix"]),
        case("/specimen/radius_mm", json!(3), &["unknown field", "size_mm", "boundary"]),
        case("/mix/grading/d_max_mm", json!(3), &["unknown field", "name"]),
        case("/mix/phi", json!(0.5), &["unknown field", "volume_fraction"]),
        case("/specimen/type", json!("sphere"), &["\"sphere\"", "\"box\"", "\"cylinder\""]),
        case("/mix/grading/type", json!("gaudin"), &["\"gaudin\"", "\"fuller\"", "\"sieves\""]),
        case("/mix/grading/name", json!("A64"), &["\"A64\"", "\"A16\"", "\"C32\""]),
        case(
            "/mix/volume_fraction_of",
            json!("mass"),
            &["\"mass\"", "\"all_aggregate\"", "\"placed_grains\""],
        ),
        case("/specimen/boundary", json!("open"), &["\"open\"", "\"walls\"", "\"periodic\""]),
        at("/distance", json!({"type": "minimize"}), "/distance/type", &["\"minimize\"", "\"maximize\""]),
        at(
            "/method",
            json!({"type": "dem"}),
            "/method/type",
            &["\"dem\"", "\"rsa\"", "\"edmd\"", "\"auto\""],
        ),
        without("", "specimen", "/specimen"),
        without("", "mix", "/mix"),
        without("/specimen", "size_mm", "/specimen/size_mm"),
        without("/specimen", "type", "/specimen/type"),
        without("/mix", "volume_fraction", "/mix/volume_fraction"),
        without("/distance", "gap_mm", "/distance/gap_mm"),
        at("/mix", Value::Null, "/mix", &["null", "required"]),
    ]
}

fn numbers() -> Vec<Case> {
    let length: &[&str] = &["at least 1e-6", "1000000", "mm"];
    vec![
        case("/mix/d_min_mm", json!("2"), &["\"2\"", "number"]),
        case("/mix/d_min_mm", json!("NaN"), &["\"NaN\"", "number"]),
        case("/mix/d_min_mm", json!(-2.5), &["-2.5", "at least 1e-6"]),
        case("/mix/d_min_mm", json!(0), &["0", "at least 1e-6"]),
        case("/mix/d_min_mm", json!(1e300), &["1000000"]),
        case("/mix/d_min_mm", json!([2]), &["an array", "number"]),
        case("/mix/volume_fraction", json!(1.5), &["1.5", "at most 1"]),
        case("/mix/volume_fraction", json!(-0.1), &["-0.1", "at least 1e-9"]),
        case("/mix/volume_fraction", json!(0), &["0", "at least 1e-9"]),
        case("/mix/volume_fraction", json!(true), &["true", "number"]),
        at("/specimen/size_mm", json!([0, 40, 40]), "/specimen/size_mm/0", length),
        at("/specimen/size_mm", json!([40, -1, 40]), "/specimen/size_mm/1", length),
        at("/specimen/size_mm", json!([40, 40, 1e7]), "/specimen/size_mm/2", length),
        case("/specimen/size_mm", json!([40, 40]), &["2 items", "exactly 3"]),
        case("/specimen/size_mm", json!([40, 40, 40, 40]), &["4 items", "exactly 3"]),
        case("/specimen/size_mm", json!(40), &["40", "array"]),
        at("/distance", json!({"type": "constant", "gap_mm": -1}), "/distance/gap_mm", &["-1", "at least 0"]),
        at(
            "/distance",
            json!({"type": "proportional", "factor": 101}),
            "/distance/factor",
            &["101", "at most 100"],
        ),
        at(
            "/distance",
            json!({"type": "none", "wall_gap_mm": -1}),
            "/distance/wall_gap_mm",
            &["-1", "at least 0"],
        ),
        at(
            "/method",
            json!({"type": "rsa", "attempts_per_grain": 0}),
            "/method/attempts_per_grain",
            &["0", "from 1 to 1000000000000"],
        ),
        at(
            "/method",
            json!({"type": "rsa", "attempts_per_grain": 1.5}),
            "/method/attempts_per_grain",
            &["1.5", "whole number"],
        ),
        case("/seed", json!(-1), &["-1", "from 0 to 9007199254740991"]),
        case("/seed", json!(9_007_199_254_740_992_u64), &["9007199254740992", "9007199254740991"]),
        case("/seed", json!(0.5), &["0.5", "whole number"]),
        case("/seed", json!("1"), &["\"1\"", "whole number"]),
    ]
}

fn gradings() -> Vec<Case> {
    let grading = |value: Value, pointer, says| at("/mix/grading", value, pointer, says);
    let sieves =
        |points: Value, pointer, says| grading(json!({"type": "sieves", "points": points}), pointer, says);
    let classes = |classes: Value, pointer, says| {
        grading(json!({"type": "classes", "classes": classes}), pointer, says)
    };
    let class = |d_min: f64, d_max: f64, mass: f64| json!({"d_min_mm": d_min, "d_max_mm": d_max, "mass_fraction": mass});
    vec![
        case("/mix/d_min_mm", json!(16), &["16", "less than"]),
        case("/mix/d_min_mm", json!(20), &["20", "less than", "16"]),
        case("/mix/d_min_mm", json!(0.1), &["0.1", "0.25"]),
        sieves(json!([[4, 0.2], [2, 0.5], [16, 1]]), "/mix/grading/points/0", &["not fall", "2", "4"]),
        sieves(json!([[4, 0.2], [4, 0.5], [16, 1]]), "/mix/grading/points/1", &["stands in two points"]),
        sieves(json!([[2, 0.5], [4, 0.2], [16, 1]]), "/mix/grading/points/1", &["not fall", "0.2", "0.5"]),
        sieves(json!([[2, -0.1], [16, 1]]), "/mix/grading/points/0/1", &["-0.1", "at least 0"]),
        sieves(json!([[2, 0.1], [16, 110]]), "/mix/grading/points/1/1", &["110", "at most 100"]),
        sieves(json!([[2, 0.1], [4, 30], [16, 100]]), "/mix/grading/points", &["0.1", "10 %", "percents"]),
        sieves(json!([[2, 0.1], [16, 0.8]]), "/mix/grading/points/1", &["0.8", "must be 1", "125 mm"]),
        sieves(json!([[2, 0.1]]), "/mix/grading/points", &["1 point", "at least 2"]),
        sieves(json!([]), "/mix/grading/points", &["0 points", "at least 2"]),
        sieves(json!([[2], [16, 1]]), "/mix/grading/points/0", &["1 items", "exactly 2"]),
        classes(json!([]), "/mix/grading/classes", &["0 classes", "at least 1"]),
        classes(json!([class(8.0, 4.0, 0.5)]), "/mix/grading/classes/0", &["8", "less than", "4"]),
        classes(json!([class(4.0, 4.0, 0.5)]), "/mix/grading/classes/0", &["less than"]),
        classes(json!([class(2.0, 8.0, 0.5), class(4.0, 16.0, 0.5)]), "/mix/grading/classes/1", &["overlap"]),
        classes(
            json!([class(2.0, 8.0, 0.7), class(8.0, 16.0, 0.7)]),
            "/mix/grading/classes",
            &["1.4", "at most 1"],
        ),
        grading(
            json!({"type": "fuller", "d_max_mm": 16, "exponent": 1.5}),
            "/mix/grading/exponent",
            &["1.5", "at most 1"],
        ),
        grading(json!({"type": "fuller", "d_max_mm": 1.5, "exponent": 0.5}), "/mix/d_min_mm", &["2", "1.5"]),
        grading(
            json!({"type": "monodisperse", "diameter_mm": -4}),
            "/mix/grading/diameter_mm",
            &["-4", "at least 1e-6"],
        ),
        Case {
            job: json!({
                "specimen": {"type": "box", "size_mm": [40, 40, 40]},
                "mix": {"grading": {"type": "diameters", "diameters_mm": [4, 0, 4]}}
            }),
            kind: "validation-error",
            pointer: "/mix/grading/diameters_mm/1",
            says: &["0", "at least 1e-6"],
        },
        Case {
            job: json!({
                "specimen": {"type": "box", "size_mm": [40, 40, 40]},
                "mix": {"grading": {"type": "diameters", "diameters_mm": [4]}, "volume_fraction": 0.3}
            }),
            kind: "validation-error",
            pointer: "/mix/volume_fraction",
            says: &["prescribes"],
        },
    ]
}

fn what_cannot_be_packed() -> Vec<Case> {
    vec![
        // 16 mm grains, walls 12 mm apart.
        at("/specimen/size_mm", json!([40, 40, 12]), "/specimen/size_mm", &["12", "16"]),
        at(
            "/specimen",
            json!({"type": "cylinder", "diameter_mm": 15, "height_mm": 40}),
            "/specimen",
            &["15", "16"],
        ),
        // Equal spheres fill 0.7405 at most (Kepler's conjecture, proven).
        of_kind(
            "infeasible-mix",
            at(
                "/mix",
                json!({"grading": {"type": "monodisperse", "diameter_mm": 2}, "volume_fraction": 0.75}),
                "/mix/volume_fraction",
                &["0.75", "0.7405"],
            ),
        ),
        // The grains themselves would fit; the shells of half the distance around them do not.
        of_kind(
            "infeasible-mix",
            at("/distance", json!({"type": "constant", "gap_mm": 5}), "/mix/volume_fraction", &["distance"]),
        ),
        of_kind("too-large", at("/specimen/size_mm", json!([9e5, 9e5, 9e5]), "/mix/d_min_mm", &["20000000"])),
    ]
}

fn job_fields() -> Vec<Case> {
    vec![
        case("/name", json!("n".repeat(201)), &["201", "200"]),
        case("/name", json!(7), &["7", "string"]),
        case("/labels", json!(["a"]), &["an array", "object"]),
        at("/labels", json!({"series": 7}), "/labels/series", &["7", "string"]),
        case("/threads", json!(0), &["0", "from 1 to 64"]),
        case("/threads", json!(65), &["65", "from 1 to 64"]),
        case("/threads", json!("2"), &["2", "whole number"]),
        case("/priority", json!(101), &["101", "from -100 to 100"]),
        case("/priority", json!(0.5), &["0.5", "whole number"]),
        case("/timeout_s", json!(0), &["0"]),
        case("/timeout_s", json!(-5), &["-5"]),
        case("/timeout_s", json!("soon"), &["\"soon\"", "number"]),
        case("/max_attempts", json!(0), &["0", "from 1 to 10"]),
        case("/max_attempts", json!(11), &["11", "from 1 to 10"]),
        case("/expires_at", json!("tomorrow"), &["\"tomorrow\"", "RFC 3339"]),
        case("/expires_at", json!("2001-01-01T00:00:00Z"), &["2001-01-01", "later than now"]),
    ]
}

fn placements_and_contents() -> Vec<Case> {
    let gradient = |field: Value, pointer, says| {
        at("/segregation", json!({"type": "gradient", "field": field, "strength": 1}), pointer, says)
    };
    let content = |content: Value, pointer, says| {
        let mut job = jobs::quick(1);
        job["mix"].as_object_mut().unwrap().remove("volume_fraction");
        Case { job: jobs::with(job, "/mix/proportions", content), kind: "validation-error", pointer, says }
    };
    vec![
        at("/segregation", json!({"type": "sorted"}), "/segregation/type", &["\"sorted\"", "\"gradient\""]),
        at(
            "/segregation",
            json!({"type": "none", "strength": 1}),
            "/segregation/strength",
            &["unknown field"],
        ),
        at(
            "/segregation",
            json!({"type": "gradient", "field": {"type": "linear", "axis": "z"}, "strength": 1001}),
            "/segregation/strength",
            &["1001", "at most 1000"],
        ),
        gradient(json!({"type": "linear", "axis": "r"}), "/segregation/field/axis", &["\"r\"", "\"z\""]),
        gradient(
            json!({"type": "linear", "axis": "z", "direction": "left"}),
            "/segregation/field/direction",
            &["\"left\"", "\"down\""],
        ),
        gradient(
            json!({"type": "face", "face": "side"}),
            "/segregation/field/face",
            &["\"side\"", "\"z_min\""],
        ),
        case(
            "/mix/proportions",
            json!({"cement_kg_m3": 300, "water_cement": 0.5}),
            &["volume_fraction", "leave one"],
        ),
        content(json!({"water_cement": 0.5}), "/mix/proportions/cement_kg_m3", &["missing"]),
        content(
            json!({"cement_kg_m3": 300, "water_cement": 0.5, "air": 0.02, "aggregate_cement": 6}),
            "/mix/proportions/air",
            &["aggregate_cement", "leave one"],
        ),
        content(
            json!({"cement_kg_m3": 300, "water_cement": 0.5, "aggregate_cement": 8}),
            "/mix/proportions",
            &["aggregate 0.9057", "sum to 1.1509", "-0.1509 of air"],
        ),
    ]
}

async fn refused(client: &Client, case: &Case) {
    let context = format!("{} at {:?}", case.kind, case.pointer);
    let reply = client.post("/v1/jobs").json(&case.job).send().await;
    assert_eq!(reply.status, 422, "{context} was not refused: {}", String::from_utf8_lossy(&reply.body));
    let problem = reply.expect_problem(422, case.kind);
    let errors = problem["errors"].as_array().unwrap_or_else(|| panic!("{context}: {problem:#}"));
    let starts = |error: &&Value| error["pointer"].as_str().is_some_and(|p| p.starts_with(case.pointer));
    // Where two fields contradict each other either may be named; then the case names their parent.
    let error = errors.iter().find(starts).unwrap_or_else(|| panic!("{context}: {problem:#}"));
    for word in case.says {
        assert!(error["detail"].as_str().unwrap().contains(word), "{context}: no {word:?} in {error:#}");
    }
    assert_eq!(errors.len(), 1, "{context}: one fault is one error: {problem:#}");
}

#[tokio::test]
async fn every_faulty_field_is_named_with_its_value_and_bound() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let groups = [
        unknown_and_missing(),
        numbers(),
        gradings(),
        what_cannot_be_packed(),
        job_fields(),
        placements_and_contents(),
    ];
    for case in groups.iter().flatten() {
        refused(&client, case).await;
    }
    let listed = client.get("/v1/jobs").send().await.json();
    assert_eq!(listed["items"], json!([]), "a refused job was stored");
    // The job that all these are made from is fine.
    client.succeed(&jobs::quick(1)).await;
    server.stop().await;
}

#[tokio::test]
async fn all_faults_are_reported_at_once() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let job = json!({
        "name": 1, "priority": 1000, "seed": -1, "colour": "red",
        "specimen": {"type": "box", "size_mm": [0, -1, 40], "boundary": "open"},
        "mix": {"grading": {"type": "standard", "name": "A64"}, "d_min_mm": -1, "volume_fraction": 2},
        "distance": {"type": "constant", "gap_mm": -1, "a/b~c": 1}
    });
    let problem =
        server.client().post("/v1/jobs").json(&job).send().await.expect_problem(422, "validation-error");
    let mut pointers: Vec<&str> = problem["errors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|error| error["pointer"].as_str().unwrap())
        .collect();
    pointers.sort_unstable();
    let expected = [
        "/colour",
        "/distance/a~1b~0c",
        "/distance/gap_mm",
        "/mix/d_min_mm",
        "/mix/grading/name",
        "/mix/volume_fraction",
        "/name",
        "/priority",
        "/seed",
        "/specimen/boundary",
        "/specimen/size_mm/0",
        "/specimen/size_mm/1",
    ];
    assert_eq!(pointers, expected);
    server.stop().await;
}

#[tokio::test]
async fn limits_of_grains_and_memory_are_the_operator_s() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-grains", "1000"]).start().await;
    let client = server.client();
    let refused = client.post("/v1/jobs").json(&jobs::equal_spheres(1200, 1)).send().await;
    let problem = refused.expect_problem(422, "too-large");
    let detail = problem["errors"][0]["detail"].as_str().unwrap();
    assert!(detail.contains("about 1200 grains") && detail.contains("1000"), "{detail}");
    client.succeed(&jobs::equal_spheres(900, 1)).await;
    server.stop().await;

    let server = Launch::new(&data_dir).args(&["--max-memory-mib", "100"]).start().await;
    let refused = server.client().post("/v1/jobs").json(&jobs::equal_spheres(5_000_000, 1)).send().await;
    let problem = refused.expect_problem(422, "too-large");
    let detail = problem["errors"][0]["detail"].as_str().unwrap();
    assert!(detail.contains("memory") && detail.contains("104857600"), "{detail}");
    server.stop().await;
}
