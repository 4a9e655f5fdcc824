//! `report CAPTURE --fit`: its rows, its files, and that a second run makes only what is missing.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::small_stage::stage;
use crate::tool::aarc_studio;
use image::Rgb;
use serde_json::Value;

/// The report with few steps on five cameras of the stage; camera 03 is held.
fn report(folder: &Path) -> Value {
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/lpips_weights");
    let weights = ["alexnet.pth", "alex.pth"].map(|name| weights.join(name).display().to_string()).join(",");
    let args = "report stage --fit -o out --cameras 00,02,03,04,06 --steps 20 --gaussians 300 --sh-degree 0 \
                --budgets 150 --compare brighter=other --json --lpips-weights";
    let args: Vec<&str> = args.split_whitespace().chain([weights.as_str()]).collect();
    aarc_studio(folder, &args).json()["ablation"].take()
}

/// Pictures of the held camera, each brighter than its photograph by 8 of 255.
fn write_brighter(folder: &Path) {
    let (from, to) = (folder.join("stage/images/03"), folder.join("other/03"));
    fs::create_dir_all(&to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let mut image = image::open(entry.path()).unwrap().to_rgb8();
        image
            .pixels_mut()
            .for_each(|pixel| *pixel = Rgb(pixel.0.map(|x| if x > 200 { x - 8 } else { x + 8 })));
        image.save(to.join(entry.file_name())).unwrap();
    }
}

/// When each result in the folder was written.
fn results(folder: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is_result = |path: &Path| {
            ["ply", "csv", "aarc"]
                .iter()
                .any(|end| path.extension().is_some_and(|extension| extension == *end))
        };
        if path.is_dir() {
            found.extend(results(&path));
        } else if is_result(&path) && !path.to_string_lossy().ends_with("fit.csv") {
            found.insert(path.clone(), path.metadata().unwrap().modified().unwrap());
        }
    }
    found
}

#[test]
fn a_capture_has_an_ablation() {
    let folder = stage();
    let folder = folder.path();
    write_brighter(folder);
    let first = report(folder);
    let names = |key: &str| -> Vec<String> {
        first[key].as_array().unwrap().iter().map(|row| row["name"].as_str().unwrap().to_owned()).collect()
    };
    let papers = ["paper's rule", "paper's rule, no floor", "paper's rule, no floor, no anchor"];
    let parts = ["full", "no anchor", "no motion start", "blur", "no fragment term", "fragment term doubled"];
    let fits = [&parts[..], &papers, &["with LPIPS"]].concat();
    assert_eq!(names("methods"), [&fits[..], &["brighter"]].concat());
    assert_eq!(names("left_out"), ["no mirror", "no plate", "nothing learned of cameras"]);
    for method in &first["methods"].as_array().unwrap()[..fits.len()] {
        for split in ["interp_a", "interp_b", "recon", "train"] {
            let measures = &method["splits"][split];
            assert!(measures["psnr_fg"].as_f64().is_some_and(|db| (5.0..40.0).contains(&db)), "{method}");
            assert!(measures["lpips"].as_f64().is_some_and(|distance| distance > 0.0), "{method}");
        }
        assert!(method["fit"]["gaussians"].as_u64().is_some_and(|count| count > 0), "{method}");
        assert!(method["fragments_per_lit_pixel"].as_f64().is_some_and(|count| count >= 1.0), "{method}");
    }
    let other = &first["methods"][fits.len()];
    assert!(other["fit"].is_null() && other["splits"]["train"].is_null(), "{other}");
    assert!(other["about"].as_str().unwrap().contains("5 of 25 photographs"), "{other}");
    // 20 log10 (255 / 8) dB.
    let psnr = other["splits"]["recon"]["psnr_fg"].as_f64().unwrap();
    assert!((psnr - 30.07).abs() < 0.01, "{psnr}");
    let packages = first["packages"].as_array().unwrap();
    // Without a reset in so few steps, two of the paper's rows have the field, and the package, of that without a
    // fragment term.
    assert_eq!(packages.len(), fits.len() - 2);
    for package in packages {
        let number = |key: &str| package[key].as_f64().unwrap();
        assert!(number("gaussians") <= 150.0 && (0.0..=1.0).contains(&number("topology")), "{package}");
        // Five frames at the 30 per second that a stage has.
        assert!((number("mbps") - number("bytes") * 8e-6 / (4.0 / 30.0)).abs() < 1e-6, "{package}");
        assert!(package["splits"]["interp_a"]["psnr_fg"].as_f64().is_some(), "{package}");
    }

    let out = folder.join("out");
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    // One held photograph of each split at least, with the pictures of eleven methods.
    assert!(
        page.matches("data:image/png").count() >= 3 * 11 && page.contains("<b>no mirror</b> is left out")
    );
    let numbers = fs::read_to_string(out.join("report.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&numbers).unwrap()["ablation"], first);

    let before = results(&out);
    assert_eq!(before.len(), 10 * 2 + 8 * 2 + 1, "{before:?}");
    assert_eq!(report(folder), first, "nothing is made again");
    assert_eq!(results(&out), before);

    let field = fs::read(out.join("papers-rule/field.ply")).unwrap();
    assert_ne!(
        fs::read(out.join("no-anchor/field.ply")).unwrap(),
        fs::read(out.join("full/field.ply")).unwrap()
    );
    fs::remove_file(out.join("papers-rule/field.ply")).unwrap();
    fs::write(out.join("full/150.aarc"), "damaged").unwrap();
    let third = report(folder);
    assert_eq!(third["packages"], first["packages"]);
    assert_eq!(fs::read(out.join("papers-rule/field.ply")).unwrap(), field, "the same fit");
    let after = results(&out);
    let remade: Vec<&Path> = after
        .iter()
        .filter(|(path, written)| before[*path] != **written)
        .map(|(path, _)| path.strip_prefix(&out).unwrap())
        .collect();
    assert_eq!(remade, [Path::new("full/150.aarc"), Path::new("papers-rule/field.ply")]);
}
