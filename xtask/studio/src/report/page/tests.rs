//! The page and its files hold all findings.

use super::*;
use crate::fit::log::{Density, LogEntry};
use crate::report::fitting::FitLog;
use measure::parameter::{ImageErrors, Quartiles};
use measure::playing::{ClipFeature, NamedPicture, Playing, PlayingSetup, ResourceUse};

fn point(value: &str, cost: f64, psnr_db: f64) -> ParameterValue {
    let time = Quartiles { low: cost - 0.25, median: cost, high: cost + 0.25 };
    let counts = [("covered_fragments", 12_345_678.0), ("pipelines", 1.0)];
    let point = ParameterValue::new(value, value == "exact", time, psnr_db, &counts);
    ParameterValue {
        errors: ImageErrors {
            ssim: Some(0.99),
            worst_tile_db: Some(30.5),
            flicker: Some(0.125),
            ..point.errors
        },
        run_time_ms: Some(time),
        stages_ms: [("sort".to_owned(), Quartiles::exactly(1.5))].into(),
        ..point
    }
}

fn findings() -> Findings {
    let parameter = Parameter {
        stage: FlowStage::Playing,
        name: "cut < off".into(),
        about: "How far.".into(),
        why_default: "fields are fitted with it".into(),
        cost: "ms a frame".into(),
        points: vec![point("exact", 9.0, 50.0), point("near", 4.0, 52.0)],
    };
    let resources = |bytes: f64| ResourceUse {
        counts: [("gpu_bytes".to_owned(), bytes)].into(),
        frame_ms: Some(Quartiles::exactly(3.0)),
    };
    let feature = ClipFeature {
        name: "SH of degree 1".into(),
        left_out: true,
        needs: "no".into(),
        switched_on: "zeros".into(),
        without: resources(1000.0),
        with: resources(5000.0),
    };
    let setup = PlayingSetup {
        adapter: "a device".into(),
        driver: "Mesa".into(),
        f16: true,
        gpu_timed: true,
        size: [64, 48],
        gaussians: 1234,
        pictures: 4,
        turn_frames: 8,
        rounds: 7,
        steps: 1,
    };
    let pictures =
        ["reference", "</script>"].map(|name| NamedPicture { name: name.into(), png: "AAAA".into() });
    let entry = |step: u64, held: f64| LogEntry {
        step,
        seconds: step as f64,
        loss: 0.1,
        held_psnr_db: Some(held),
        gaussians: 500,
        drawn: 400,
        density: Density::default(),
        backend: "cpu".into(),
    };
    Findings {
        name: "a & b".into(),
        machine: "two cores".into(),
        playing: Playing {
            setup,
            parameters: vec![parameter.mark_front()],
            features: vec![feature],
            pictures: pictures.into(),
        },
        packaging: Vec::new(),
        fits: vec![FitLog { name: "one".into(), entries: vec![entry(10, 20.0), entry(20, 22.0)] }],
    }
}

/// The findings with a parameter of these values.
fn findings_of(points: Vec<ParameterValue>) -> Findings {
    let mut findings = findings();
    let parameter = Parameter { points, ..findings.playing.parameters.remove(0) };
    findings.playing.parameters.push(parameter.mark_front());
    findings
}

#[test]
fn the_page_is_self_contained_and_names_beaten_defaults() {
    let ReportPart { title, body, .. } = findings().part().unwrap();
    let page = crate::page::page(&[(&title, &body)]);
    assert!(page.contains("<title>a &amp; b: error against run time</title>"));
    assert!(
        page.contains(
            "<li>cut &lt; off: near has 2.00 dB more and costs 5 ms a frame less than the default, exact (50 dB at \
             9 ms a frame), which stands because fields are fitted with it.</li>"
        ),
        "{page}"
    );
    for expected in ["12,345,678", "9.00 <small>8.75 to 9.25</small>", "4,000", "two cores", "a device, Mesa"]
    {
        assert!(page.contains(expected), "no {expected} in {page}");
    }
    // A plot for the parameter, one of fits over steps, one over time, one over work.
    assert_eq!(page.matches("<svg").count(), 4);
    assert_eq!(page.matches("r=\"7\"").count(), 2, "both lines of the fit are on its front");
    assert!(page.contains("10 to 20 (2 of 2)"), "{page}");
    // Names of pictures cannot end the script, and the page loads nothing.
    assert_eq!(page.matches("</script>").count(), 1);
    for foreign in ["src=\"http", "href=", "@import", "url("] {
        assert!(!page.contains(foreign), "{foreign}");
    }
}

#[test]
fn rows_have_the_documented_keys() {
    let findings = findings();
    let json = findings.part().unwrap().json;
    let row = &json["knobs"][0];
    assert_eq!((&row["name"], &row["value"]), (&"cut < off".into(), &"exact".into()));
    assert_eq!((row["error_db"].as_f64(), row["run_time_ms"].as_f64()), (Some(50.0), Some(9.0)));
    assert_eq!(row["counts"]["covered_fragments"], 12_345_678.0);
    assert_eq!((&row["default"], &row["on_front"]), (&true.into(), &false.into()));
    assert_eq!(json["knobs"][1]["on_front"], true);
    assert_eq!(json["knobs"].as_array().unwrap().len(), 4, "two values, two lines of a fit");
}

#[test]
fn the_terminal_shows_every_value() {
    let table = findings().part().unwrap().text;
    assert!(
        table.contains("* exact") && table.contains("  near") && table.contains("off the front"),
        "{table}"
    );
}

#[test]
fn a_beaten_default_says_by_how_much_and_why_it_stands() {
    let beaten = |points| findings_of(points).beaten_defaults();
    let said = |others| beaten([vec![point("exact", 9.0, 50.0)], others].concat()).remove(0);
    let faster = said(vec![point("fast", 4.0, 49.95), point("faster", 3.0, 49.96)]);
    let expected = "faster (as 1 other value) has only 0.04 dB less and costs 6 ms a frame less than";
    assert!(faster.contains(expected), "{faster}");
    let perfect = said(vec![point("perfect", 9.0, f64::INFINITY)]);
    assert!(
        perfect.contains("perfect is without error and costs no more than the default, exact"),
        "{perfect}"
    );
    assert!(beaten(vec![point("exact", 9.0, 50.0), point("slow", 12.0, 60.0)]).is_empty());
}

#[test]
fn what_has_no_error_is_named_where_a_chart_cannot_show_it() {
    let exact = || point("exact", 9.0, f64::INFINITY);
    let page = |points| findings_of(points).part().unwrap().body;
    let named = page(vec![exact(), point("near", 4.0, 52.0), point("far", 3.0, 40.0)]);
    assert!(named.contains("<p>Without an error, and so not in the chart: exact.</p>"), "{named}");
    assert!(!page(vec![point("near", 4.0, 52.0), point("far", 3.0, 40.0)]).contains("Without an error"));
}

#[test]
fn a_parameter_of_one_value_has_a_sentence_in_place_of_a_chart() {
    let mut findings = findings_of(vec![point("exact", 9.0, 50.0)]);
    findings.fits[0].entries.truncate(1);
    let page = findings.part().unwrap().body;
    assert_eq!(page.matches("<svg").count(), 0, "{page}");
    assert_eq!(page.matches("No chart of ").count(), 3, "{page}");
}
