//! The report's measurements of playing: every parameter trades error for work, and a feature that a clip
//! lacks saves exactly what it would cost.

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Recipe, decoded_with};
use client::gpu::Gpu;
use codec::{Clip, Field};
use glam::UVec2;
use libtest_mimic::Trial;
use measure::parameter::{Parameter, ParameterValue};
use measure::playing::{self, ClipFeature, Playing};
use refine::reference::RenderScene;
use shaders::sh_words;
use studio::package::LAYERS;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("parameters trade error for work", Passes::Shared, parameters_trade),
        gpu::trial("features that are left out", Passes::Shared, features_left_out),
        gpu::trial("a static clip", Passes::Shared, a_static_clip),
    ]
}

const COUNT: usize = 300;

const RECIPE: Recipe =
    Recipe { count: COUNT, sh_degree: 1, motion: Motion::Mixed, motion_order: 2, turning: true, seed: 6 };

/// Packages `field` and measures the clip.
fn measured(gpu: &'static Gpu, field: &Field) -> Result<(Clip, Playing), String> {
    let clip = decoded_with(field, None, &[100]);
    let mut steps = 0;
    let mut on_step = |_: &str, _| steps += 1;
    let whole = RenderScene::from(field);
    let playing = playing::measure(gpu, &clip, &whole, UVec2::new(96, 72), &LAYERS, &mut on_step)
        .map_err(|error| format!("{error:#}"))?;
    expect("steps are as announced", playing.setup.steps == steps)?;
    expect("the fragments are as drawn", playing.setup.f16 == gpu.caps.f16)?;
    Ok((clip, playing))
}

fn expect(what: &str, holds: bool) -> Result<(), String> {
    if holds { Ok(()) } else { Err(what.into()) }
}

fn parameter<'a>(playing: &'a Playing, name: &str) -> Result<&'a Parameter, String> {
    playing.parameters.iter().find(|parameter| parameter.name == name).ok_or(format!("no parameter {name}"))
}

fn feature<'a>(playing: &'a Playing, name: &str) -> Result<&'a ClipFeature, String> {
    playing.features.iter().find(|feature| feature.name == name).ok_or(format!("no feature {name}"))
}

/// Difference of a count with and without a feature.
fn saved(feature: &ClipFeature, count: &str) -> Result<f64, String> {
    let missing = || format!("no {count} of {}", feature.name);
    let [with, without] = [&feature.with, &feature.without].map(|side| side.counts.get(count).copied());
    Ok(with.ok_or_else(missing)? - without.ok_or_else(missing)?)
}

fn parameters_trade(gpu: &'static Gpu) -> Result<(), String> {
    let (_, playing) = measured(gpu, &RECIPE.field())?;
    for parameter in &playing.parameters {
        let [default, others @ ..] = parameter.points.as_slice() else {
            return Err("a parameter of no values".into());
        };
        let (finest, name) = (default.psnr_db(), &parameter.name);
        expect(&format!("{name}: {finest} dB by default"), default.default && finest > 40.0)?;
        let coarsest = others.last().ok_or("a parameter of one value")?;
        expect(&format!("{name}: {} dB at its end", coarsest.psnr_db()), coarsest.psnr_db() < finest)?;
        let timed = |point: &ParameterValue| point.run_time_ms.is_some_and(|time| time.low > 0.0);
        expect(&format!("{name}: it takes time"), parameter.points.iter().all(timed))?;
    }
    for (name, count) in [
        ("layers", "sorted_keys"),
        ("cutoff", "covered_fragments"),
        ("temporal cull", "sorted_keys"),
        ("resolution scale", "covered_fragments"),
        ("SH degree", "gpu_bytes"),
        ("motion order", "gpu_bytes"),
        ("rotation over time", "gpu_bytes"),
    ] {
        let counts: Vec<f64> =
            parameter(&playing, name)?.points.iter().map(|point| point.counts[count]).collect();
        let falls = counts.is_sorted_by(|a, b| a >= b) && counts[0] > counts[counts.len() - 1];
        expect(&format!("{name}: {count} {counts:?}"), falls)?;
    }
    let sort = parameter(&playing, "sort")?;
    let flicker = |point: &ParameterValue| point.errors.flicker.unwrap_or(f64::NAN);
    let (depth, radial) = (flicker(&sort.points[0]), flicker(&sort.points[1]));
    expect(&format!("depth flickers by {depth}, radial by {radial}"), radial < depth)?;
    expect(
        "the reference, the player and each parameter's end",
        playing.pictures.len() == 2 + playing.parameters.len(),
    )
}

fn features_left_out(gpu: &'static Gpu) -> Result<(), String> {
    let (clip, playing) = measured(gpu, &RECIPE.field())?;
    let (static_count, dynamic_count) = (clip.static_field.len(), clip.dynamic_field.len());
    let words = |order, rotates| shaders::Motion { order, rotates }.words();
    for (name, bytes) in [
        ("SH of degree 2", COUNT * 4 * (sh_words(2) - sh_words(1))),
        ("SH of degree 3", COUNT * 4 * (sh_words(3) - sh_words(1))),
        ("motion of power 3", dynamic_count * 4 * (words(3, true) - words(2, true))),
        ("temporal columns of static Gaussians", static_count * 4 * words(2, true)),
    ] {
        let feature = feature(&playing, name)?;
        let saves = saved(feature, "gpu_bytes")?;
        expect(&format!("{name}: {saves} bytes of the GPU for {bytes}"), saves == bytes as f64)?;
        expect(&format!("{name}: it is left out"), feature.left_out)?;
        let fixed = saved(feature, "package_bytes_fixed")?;
        expect(&format!("{name}: {fixed} bytes of a package"), fixed > 0.0)?;
    }
    expect("SH is needed", !feature(&playing, "SH up to degree 1")?.left_out)?;
    let compensation = feature(&playing, "opacity compensation")?;
    let lines = saved(compensation, "shader_lines")?;
    expect(&format!("compensation takes {lines} lines of the shader"), compensation.left_out && lines > 0.0)?;
    expect("turning is needed", !feature(&playing, "rotation over time")?.left_out)?;
    let tested = saved(feature(&playing, "Gaussians of other times")?, "rows_tested")?;
    expect(&format!("the time index saves {tested} tests"), tested > 0.0)?;
    expect("a plate takes a pipeline", saved(feature(&playing, "plate")?, "pipelines")? == 1.0)?;
    let eye = feature(&playing, "second eye")?;
    let more = saved(eye, "vertex_invocations")?;
    expect(&format!("a second eye takes {more} vertices"), more > 0.0)
}

/// A clip without motion and view-dependent colour carries no columns for them.
fn a_static_clip(gpu: &'static Gpu) -> Result<(), String> {
    let field = Recipe { sh_degree: 0, motion: Motion::Static, ..RECIPE }.field();
    let (clip, playing) = measured(gpu, &field)?;
    expect("there is nothing to move", clip.dynamic_field.is_empty())?;
    let absent = ["SH degree", "motion order", "rotation over time"];
    expect(
        "no parameters of what is not there",
        absent.iter().all(|name| parameter(&playing, name).is_err()),
    )?;
    let words = shaders::Motion { order: 0, rotates: false }.words();
    let windows = feature(&playing, "temporal columns of static Gaussians")?;
    expect("windows are left out", saved(windows, "gpu_bytes")? == (COUNT * 4 * words) as f64)?;
    expect("and their binding", saved(windows, "bindings")? == 1.0)?;
    for degree in 1..=3 {
        let feature = feature(&playing, &format!("SH of degree {degree}"))?;
        expect("SH is left out", saved(feature, "gpu_bytes")? == (COUNT * 4 * sh_words(degree)) as f64)?;
        expect("and its binding", saved(feature, "bindings")? == 1.0)?;
    }
    expect("there is no time index", !feature(&playing, "Gaussians of other times")?.left_out)
}
