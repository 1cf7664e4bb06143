use super::*;
use crate::plots::axis::Axis;
use crate::plots::chart::Layout;

fn svg(chart: &Chart) -> Result<String, PlotError> {
    super::svg(chart, true)
}

fn points(values: &[(f64, f64)]) -> Vec<Point> {
    values.iter().map(|&(x, y)| Point::new(x, y)).collect()
}

fn chart(series: Vec<Series>) -> Chart {
    Chart {
        title: "Time".into(),
        description: "Time against size.".into(),
        x: Axis::linear("size in mm"),
        y: Axis::log("time in s"),
        series,
        layout: Layout::default(),
        when_empty: "no run has ended".into(),
    }
}

/// Values of an attribute, in the order of the document.
fn attributes<'a>(svg: &'a str, name: &str) -> Vec<&'a str> {
    let start = format!(" {name}=\"");
    svg.split(start.as_str()).skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

#[test]
fn a_chart_has_its_size_on_paper_and_its_words() {
    let drawn = svg(&chart(vec![Series::marked("rsa", 0, points(&[(1.0, 0.1), (2.0, 20.0)]))])).unwrap();
    assert!(
        drawn.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"160mm\" height=\""),
        "{drawn}"
    );
    for said in ["<title id=\"title\">Time</title>", "<desc id=\"desc\">Time against size.</desc>"] {
        assert!(drawn.contains(said), "{said}");
    }
    for text in ["size in mm", "time in s", "rsa"] {
        assert!(drawn.contains(&format!("\n{text}\n</text>")), "{text} is not written:\n{drawn}");
    }
    assert!(drawn.trim_end().ends_with("</svg>"));
    assert_eq!(drawn.matches("<svg").count(), 1);
}

/// Journals print the title in the caption. Without a heading the picture is lower by its height, and the document
/// keeps its title for screen readers.
#[test]
fn the_heading_can_be_left_out() {
    let chart = chart(vec![Series::marked("rsa", 0, points(&[(1.0, 0.1), (2.0, 20.0)]))]);
    let [with, without] = [true, false].map(|heading| super::svg(&chart, heading).unwrap());
    let height = |drawn: &str| attributes(drawn, "height")[0].trim_end_matches("mm").parse::<f64>().unwrap();
    assert!((height(&with) - height(&without) - TITLE_MM).abs() < 1e-9);
    assert!(with.contains("\nTime\n</text>") && !without.contains("\nTime\n</text>"), "{without}");
    for drawn in [&with, &without] {
        assert!(drawn.contains("<title id=\"title\">Time</title>"), "{drawn}");
        assert!(drawn.contains("\nsize in mm\n</text>"), "{drawn}");
    }
    // Everything else is the same: as many lines, circles and texts.
    for element in ["<polyline", "<circle", "<line"] {
        assert_eq!(with.matches(element).count(), without.matches(element).count(), "{element}");
    }
    assert_eq!(with.matches("<text").count(), without.matches("<text").count() + 1);
}

#[test]
fn the_same_chart_is_the_same_bytes() {
    let make = || {
        chart((0..40).map(|n| Series::marked(format!("{n}"), n, points(&[(1.0, 0.1 + n as f64)]))).collect())
    };
    assert_eq!(svg(&make()).unwrap(), svg(&make()).unwrap());
}

#[test]
fn what_a_user_wrote_is_escaped_everywhere() {
    let nasty = "</text><script>alert(1)</script>&\"'\u{1}";
    let mut nasty_chart = chart(vec![Series::marked(nasty, 0, points(&[(1.0, 1.0), (2.0, 2.0)]))]);
    nasty_chart.title = nasty.into();
    nasty_chart.description = nasty.into();
    nasty_chart.x.label = nasty.into();
    nasty_chart.y.label = nasty.into();
    for drawn in [svg(&nasty_chart).unwrap(), super::svg(&nasty_chart, false).unwrap()] {
        assert!(!drawn.contains("<script"), "{drawn}");
        assert!(!drawn.contains('\u{1}'));
        assert!(drawn.matches("&lt;script&gt;").count() >= 3, "{drawn}");
        assert_eq!(drawn.matches("<text").count(), drawn.matches("</text>").count());
    }
}

#[test]
fn a_chart_without_data_is_refused_with_the_reason() {
    for series in [
        vec![],
        vec![Series::line("nothing", 0, vec![])],
        vec![Series::line("nowhere", 0, points(&[(1.0, f64::NAN), (2.0, -1.0), (f64::INFINITY, 1.0)]))],
        vec![Series::reference("alone", 1.0, 0.0, 1.0)],
    ] {
        for heading in [true, false] {
            match super::svg(&chart(series.clone()), heading) {
                Err(PlotError::NotAvailable(reason)) => assert_eq!(reason, "no run has ended"),
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn everything_lies_inside_whatever_the_values() {
    let wide = points(&[(-1e9, 1e-12), (0.0, 3.0), (1e9, 1e12)]);
    let narrow = points(&[(5.0, 5.0)]);
    let mut bars = points(&[(1.0, 5.0), (2.0, 6.0)]);
    bars[0].interval = Some([-1.0, 50.0]);
    bars[1].interval = Some([5.0, f64::INFINITY]);
    for data in [wide, narrow, bars] {
        let drawn = svg(&chart(vec![Series::marked("data", 3, data)])).unwrap();
        let size: Vec<f64> =
            attributes(&drawn, "viewBox")[0].split(' ').map(|text| text.parse().unwrap()).collect();
        for pair in attributes(&drawn, "points").iter().flat_map(|points| points.split_whitespace()) {
            let (x, y) = pair.split_once(',').unwrap();
            let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
            assert!((0.0..=size[2]).contains(&x) && (0.0..=size[3]).contains(&y), "{pair} in\n{drawn}");
        }
        assert!(!drawn.contains("NaN"), "{drawn}");
    }
}

#[test]
fn a_value_that_the_axis_cannot_show_interrupts_the_line() {
    let broken = points(&[(1.0, 1.0), (2.0, 2.0), (3.0, 0.0), (4.0, 4.0), (5.0, 5.0)]);
    let whole = points(&[(1.0, 1.0), (2.0, 2.0), (4.0, 4.0), (5.0, 5.0)]);
    let lines = |data| {
        let drawn = svg(&chart(vec![Series { label: None, ..Series::line("", 0, data) }])).unwrap();
        attributes(&drawn, "stroke-width")
            .iter()
            .filter(|width| **width == stroke(LINE_MM).to_string())
            .count()
    };
    assert_eq!((lines(whole), lines(broken)), (1, 2));
}

#[test]
fn a_legend_grows_with_its_entries_to_a_bound_and_never_beyond_the_page() {
    let height = |entries: usize, label: &str| -> f64 {
        let series = (0..entries).map(|n| Series::marked(format!("{label}{n}"), n, points(&[(1.0, 1.0)])));
        let drawn = svg(&chart(series.collect())).unwrap();
        attributes(&drawn, "height")[0].trim_end_matches("mm").parse().unwrap()
    };
    let long =
        "a label as long as the names of mixes can be, longer than a line of the legend can show, and on "
            .repeat(3);
    assert!(height(12, &long) > height(12, "s"), "long entries need a row each");
    assert_eq!(height(24, &long), height(500, &long));
    let repeated = (0..9).map(|_| Series::line("run", 0, points(&[(1.0, 1.0), (2.0, 3.0)])));
    let drawn = svg(&chart(repeated.collect())).unwrap();
    assert_eq!(drawn.matches("\nrun\n").count(), 1, "runs of one name share an entry");
    let drawn =
        svg(&chart((0..30).map(|n| Series::marked(format!("s{n}"), n, points(&[(1.0, 1.0)]))).collect()));
    assert!(drawn.unwrap().contains("and 7 more"));
}

#[test]
fn error_bars_at_the_same_place_stand_side_by_side() {
    let bar = |y: f64| vec![Point { interval: Some([1.0, 5.0]), ..Point::new(1.0, y) }];
    let series = |n| Series { label: None, ..Series::marked("", n, bar(2.0 + n as f64)) };
    let places = |series: Vec<Series>| {
        let drawn = svg(&chart(series)).unwrap();
        let bars = attributes(&drawn, "points").into_iter().filter_map(|points| {
            let ends: Vec<(&str, &str)> =
                points.split_whitespace().filter_map(|p| p.split_once(',')).collect();
            // Upright lines but for those of the grid, which reach over the whole height.
            let [from, to] = ends[..] else { return None };
            let height = (from.1.parse::<i32>().unwrap() - to.1.parse::<i32>().unwrap()).abs();
            (from.0 == to.0 && (300..units(PLOT_HEIGHT_MM) - 2).contains(&height)).then(|| from.0.to_owned())
        });
        bars.collect::<HashSet<String>>().len()
    };
    assert_eq!(places(vec![series(0)]), 1);
    assert_eq!(places(vec![series(0), series(1), series(2)]), 3);
    assert_eq!(places(vec![series(0), series(0)]), 1, "series of one style have the same offset");
}

#[test]
fn labels_of_the_abscissa_do_not_run_into_one_another() {
    let mut crowded = chart(vec![Series::line("", 0, points(&[(1.0, 1.0), (40.0, 2.0)]))]);
    crowded.x = Axis { ticks: (0..400).map(|n| 1.0 + f64::from(n) / 10.0).collect(), ..Axis::log("d in mm") };
    let drawn = svg(&crowded).unwrap();
    let middle: Vec<&str> = drawn.split("<text ").filter(|text| text.contains("dy=\"0.76em\"")).collect();
    let labels: Vec<(f64, &str)> = middle
        .iter()
        .filter(|text| !text.contains("rotate"))
        .map(|text| {
            let x = text.split("x=\"").nth(1).unwrap().split('"').next().unwrap();
            (x.parse().unwrap(), text.split('\n').nth(1).unwrap())
        })
        .collect();
    assert!(labels.len() > 5, "{labels:?}");
    let half = |text: &str| width_em(text) * TICK_SIZE_MM * PER_MM / 2.0;
    for pair in labels.windows(2) {
        assert!(pair[0].0 + half(pair[0].1) < pair[1].0 - half(pair[1].1), "{pair:?}");
    }
}
