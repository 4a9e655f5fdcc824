//! A take is drawn as its field unsplit, at any instant and with any segments resident.

use aarc_tests::gpu::{self, Drawing, Passes};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded_with};
use aarc_tests::takes::{SplitTake, clip_of};
use client::gpu::{
    ChannelDepth, Gpu, GpuClip, PackedLayers, PackedSegment, RenderSettings, Renderer, SlotId, Span,
    TakeLayout,
};
use codec::{Camera, Clip, Field, Limits, PixelFilter};
use libtest_mimic::Trial;
use measure::resident::ResidentSegments;
use program::Fault;
use refine::image::Image;
use refine::reference::{Order, RenderScene, render};

/// As in the other comparisons with the reference.
const TOLERANCE: Tolerance = Tolerance { max_diff: 2.0, diff_pixels: 100, psnr: 54.0 };

const SIZE: (u32, u32) = (160, 120);

/// Bytes of an upload; no multiple of a record.
const PIECE: usize = 5000;

const RECIPE: Recipe =
    Recipe { count: 1200, sh_degree: 1, motion: Motion::Dynamic, motion_order: 3, turning: true, seed: 12 };

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("a take of one segment is its clip", Passes::Shared, one_segment),
        gpu::trial("a field split into levels, one eye", Passes::Shared, |gpu| split(gpu, false)),
        gpu::multiview_trial("a field split into levels, two eyes in one pass", |gpu| split(gpu, true)),
        gpu::trial("a field split into levels, two eyes in two passes", Passes::PerEye, |gpu| {
            split(gpu, true)
        }),
        gpu::trial("a field split into levels, foveated, and counted", Passes::Shared, foveated),
        gpu::trial("an instant after an hour is as exact as one at the start", Passes::Shared, hour),
        gpu::trial("uploads in pieces", Passes::Shared, pieces),
        gpu::trial("layers of a segment that arrive one by one", Passes::Shared, appended),
        gpu::trial("room is used again", Passes::Shared, room),
        gpu::trial("a picture of a take outlives its segments", Passes::Shared, shared),
    ]
}

fn text(fault: Fault) -> String {
    fault.to_string()
}

/// A drawing of a take without segments.
fn drawing<'a>(gpu: &'a Gpu, layout: TakeLayout, cameras: &[Camera]) -> Result<Drawing<'a>, String> {
    Drawing::by(gpu, cameras, ChannelDepth::Sixteen, |frame| Renderer::new_take(gpu, layout, frame))
        .map_err(text)
}

fn whole() -> Camera {
    camera(Place::Whole, SIZE.0, SIZE.1)
}

/// Inserts a segment and uploads all of it.
fn insert(
    gpu: &Gpu,
    drawing: &mut Drawing<'_>,
    (clip, span): (&Clip, Span),
    layout: &TakeLayout,
) -> Result<SlotId, String> {
    let packed = PackedSegment::new(clip, span, layout).map_err(text)?;
    let slots = drawing.renderer().slots().ok_or("no take")?;
    let id = slots.insert(packed).ok_or("no room")?;
    slots.upload(gpu, usize::MAX);
    if slots.is_ready(id) { Ok(id) } else { Err("it is not ready".into()) }
}

fn frame(drawing: &mut Drawing<'_>, t: f64) -> Result<Image, String> {
    Ok(drawing.frame(t, &RenderSettings::default()).map_err(text)?.remove(0))
}

fn is_black(image: &Image) -> bool {
    image.pixels.iter().all(|pixel| pixel[..3] == [0.0; 3])
}

/// Fields are static and dynamic, with a plate and layers. Centres have another origin than a clip's centres, so their
/// rounding differs, and pixels by up to two steps of 16-bit floats below 1.
fn one_segment(gpu: &Gpu) -> Result<(), String> {
    for (motion, filter, near) in [
        (Motion::Static, PixelFilter::Blur, 0.0),
        (Motion::Mixed, PixelFilter::Mip, 0.0),
        // Half of the field fades.
        (Motion::Dynamic, PixelFilter::Blur, 3.0),
    ] {
        let field = Field { filter, near, ..Recipe { sh_degree: 2, motion, ..RECIPE }.field() };
        let plate = Recipe { motion: Motion::Static, count: 100, seed: 5, ..RECIPE }.field();
        let clip = decoded_with(&field, Some(&plate), &[300, 700]);
        let layout = TakeLayout::for_clip(&clip).segmented(2.5);
        let span = Span { start_s: 0.0, duration_s: 2.5 };
        let mut take = drawing(gpu, layout, &[whole()])?;
        insert(gpu, &mut take, (&clip, span), &layout)?;
        let on_gpu = GpuClip::upload(gpu, &clip).map_err(text)?;
        let mut alone = Drawing::new(gpu, on_gpu, &[whole()], ChannelDepth::Sixteen).map_err(text)?;
        for (t, layers) in [(0.0, None), (0.37, Some(1)), (0.5, None), (1.0, Some(2))] {
            let settings = RenderSettings { layers, ..RenderSettings::default() };
            let [take, alone] = [&mut take, &mut alone]
                .map(|drawing| drawing.frame(t, &settings).map_err(text).map(|mut images| images.remove(0)));
            let (take, alone) = (take?, alone?);
            if alone.pixels.iter().filter(|pixel| pixel[3] > 0.5).count() < 500 {
                return Err(format!("{motion:?}, t = {t}: the clip shows too little"));
            }
            // Drivers round differently. A difference of half an 8-bit step is never visible.
            let tolerance = Tolerance { max_diff: 0.5, diff_pixels: 2, psnr: 80.0 };
            check(&format!("one segment, {motion:?}, t = {t}"), &take, &alone, tolerance.on(gpu))?;
        }
    }
    Ok(())
}

/// Played with room for what holds an instant, and little more: segments come and go, and rows are used again.
fn split(gpu: &Gpu, stereo: bool) -> Result<(), String> {
    let take = SplitTake::new(&RECIPE, 24.0, 1.5);
    let cameras = if stereo { whole().stereo_pair(0.065).to_vec() } else { vec![whole()] };
    let layout = take.layout(take.resident_max() * 3 / 2);
    if layout.room.total() >= take.field.len() {
        return Err("all segments are resident, so no row is used again".into());
    }
    let mut drawing = drawing(gpu, layout, &cameras)?;
    let mut player = ResidentSegments::new(layout, take.segments.len());
    let scene = RenderScene::from(&take.field);
    // On cuts, between them, forwards and back.
    let steps = if stereo { 9 } else { 61 };
    let times = (0..steps).map(|i| take.duration_s * f64::from(i) / f64::from(steps - 1));
    let (mut changes, mut before, mut pictures) = (0, None::<Image>, 0);
    for t_s in times.chain([7.77, 1.5, 20.2, 2.999_999, 3.0]) {
        let t = t_s / take.duration_s;
        changes += player.seek(gpu, drawing.renderer(), &take.segments, t_s, PIECE).map_err(text)?;
        let images = drawing.frame(t, &RenderSettings::default()).map_err(text)?;
        for (eye, (image, camera)) in images.iter().zip(&cameras).enumerate() {
            let expected = render(&scene, camera, t, Order::Depth);
            let name = format!("take, {} eyes, {}, eye {eye}, {t_s} s", cameras.len(), gpu.caps.multiview);
            check(&name, image, &expected, TOLERANCE.on(gpu))?;
            let differs = |before: Image| before.psnr(&expected) < 40.0;
            pictures += u32::from(eye == 0 && before.replace(expected.clone()).is_some_and(differs));
        }
    }
    if changes < 2 * take.segments.len() || pictures < steps - 1 {
        return Err(format!(
            "{changes} changes of {} segments, {pictures} pictures differ from the one before",
            take.segments.len()
        ));
    }
    Ok(())
}

/// Against the field unsplit, drawn as a clip.
fn foveated(gpu: &Gpu) -> Result<(), String> {
    let take = SplitTake::new(&RECIPE, 24.0, 1.5);
    let camera = camera(Place::Near, SIZE.0, SIZE.1);
    let layout = take.layout(take.resident_max() * 3 / 2);
    let mut split = drawing(gpu, layout, std::slice::from_ref(&camera))?;
    let mut player = ResidentSegments::new(layout, take.segments.len());
    let on_gpu = GpuClip::upload(gpu, &clip_of(&take.field)).map_err(text)?;
    let mut unsplit =
        Drawing::new(gpu, on_gpu, std::slice::from_ref(&camera), ChannelDepth::Sixteen).map_err(text)?;
    for (t_s, inset) in [(0.7, Some(0.4)), (6.0, Some(0.4)), (11.3, None), (23.9, Some(0.3))] {
        let settings = RenderSettings { inset, ..RenderSettings::default() };
        player.seek(gpu, split.renderer(), &take.segments, t_s, PIECE).map_err(text)?;
        let draw = |drawing: &mut Drawing<'_>| {
            let image = drawing.frame(t_s / take.duration_s, &settings).map_err(text)?.remove(0);
            Ok::<_, String>((image, drawing.renderer().count(gpu).map_err(text)?))
        };
        let ((image, coverage), (expected, whole)) = (draw(&mut split)?, draw(&mut unsplit)?);
        check(&format!("take, foveated, {t_s} s"), &image, &expected, TOLERANCE.on(gpu))?;
        // Quads differ by the rounding of their windows.
        let near = |a: u64, b: u64| a.abs_diff(b) * 200 <= b;
        if !near(coverage.fragments, whole.fragments)
            || !near(coverage.drawn.into(), whole.drawn.into())
            || whole.drawn < 100
        {
            return Err(format!("{t_s} s: {coverage:?} for {whole:?}"));
        }
    }
    Ok(())
}

/// The same segment at the start of a take and at the end of its hour, at the same instants of its own.
fn hour(gpu: &Gpu) -> Result<(), String> {
    let hour_s = 3600.0;
    let field = SplitTake::new(&RECIPE, 2.0, 2.0).field;
    let clip = clip_of(&field);
    let layout = TakeLayout::for_clip(&clip).segmented(hour_s).with_rows(2 * clip.len());
    let mut drawing = drawing(gpu, layout, &[whole()])?;
    let starts = [0.0, hour_s - 2.0];
    for start_s in starts {
        insert(gpu, &mut drawing, (&clip, Span { start_s, duration_s: 2.0 }), &layout)?;
    }
    for since_s in [0.0, 0.333, 1.0, 1.0 + 1.0 / 4096.0, 1.99] {
        let expected = render(&RenderScene::from(&field), &whole(), since_s / 2.0, Order::Depth);
        let mut images = Vec::new();
        for start_s in starts {
            let image = frame(&mut drawing, (start_s + since_s) / hour_s)?;
            check(&format!("hour, {start_s} s, {since_s} s"), &image, &expected, TOLERANCE.on(gpu))?;
            images.push(image);
        }
        let found = difference(&images[1], &images[0]);
        if found.max_diff > 0.5 {
            return Err(format!("{since_s} s into the segment: {found}"));
        }
    }
    // Between the segments nothing is drawn; at the last instant the last one is.
    if !is_black(&frame(&mut drawing, 0.5)?) || is_black(&frame(&mut drawing, 1.0)?) {
        return Err("spans".into());
    }
    Ok(())
}

/// No upload writes more than it may; a segment is drawn when it is complete, not before.
fn pieces(gpu: &Gpu) -> Result<(), String> {
    let clip = clip_of(&SplitTake::new(&RECIPE, 2.0, 2.0).field);
    let span = Span { start_s: 0.0, duration_s: 2.0 };
    let layout = TakeLayout::for_clip(&clip).segmented(2.0).with_rows(2 * clip.len());
    let mut take = drawing(gpu, layout, &[whole()])?;
    let mut ids = Vec::new();
    let mut total = 0;
    for _ in 0..2 {
        let packed = PackedSegment::new(&clip, span, &layout).map_err(text)?;
        total += packed.bytes();
        ids.push(take.renderer().slots().and_then(|slots| slots.insert(packed)).ok_or("no room")?);
    }
    let (mut written, mut uploads, mut ready) = (0, 0, 0);
    let mut alone = None;
    loop {
        let slots = take.renderer().slots().ok_or("no take")?;
        let bytes = slots.upload(gpu, PIECE);
        let now = ids.iter().filter(|id| slots.is_ready(**id)).count();
        (written, uploads) = (written + bytes, uploads + 1);
        if bytes > PIECE || (bytes < PIECE - PIECE % 4 && written < total) {
            return Err(format!("{bytes} bytes of {PIECE}"));
        }
        if now != ready || uploads == 3 {
            let image = frame(&mut take, 0.5)?;
            if is_black(&image) != (now == 0) {
                return Err(format!("{now} segments are ready"));
            }
            // The second is the same once more, so the picture is denser.
            if now == 2 && alone.as_ref().is_some_and(|alone: &Image| alone.psnr(&image) > 40.0) {
                return Err("the second segment is not drawn".into());
            }
            alone = Some(image);
            ready = now;
        }
        if bytes == 0 {
            break;
        }
    }
    if (written, ready, uploads) != (total, 2, total.div_ceil(PIECE - PIECE % 4) + 1) {
        return Err(format!("{written} of {total} bytes in {uploads} uploads, {ready} are ready"));
    }
    Ok(())
}

/// A segment is drawn with the layers that are complete, while further ones are uploaded behind them: there is room for
/// the segment once.
fn appended(gpu: &Gpu) -> Result<(), String> {
    let field = Recipe { motion: Motion::Mixed, ..RECIPE }.field();
    let plate = Recipe { motion: Motion::Static, count: 100, seed: 5, ..RECIPE }.field();
    let bytes = aarc_tests::scene::packaged(&field, Some(&plate), &[200, 500]);
    let limits = Limits::default();
    let error = |error: codec::Error| error.to_string();
    let head = codec::contents(&bytes, &limits).map_err(error)?;
    let ends = head.layer_bytes();
    let mut clip = codec::decode(&bytes[..ends[0]], &limits).map_err(error)?;
    let span = Span { start_s: 0.0, duration_s: 2.0 };
    let layout = TakeLayout::for_clip(&clip).segmented(2.0).with_rows(field.len());
    let mut take = drawing(gpu, layout, &[whole()])?;
    let reference = |clip: &Clip| render(&RenderScene::from(clip), &whole(), 0.5, Order::Depth);
    let id = insert(gpu, &mut take, (&clip, span), &layout)?;
    check("take, first layers", &frame(&mut take, 0.5)?, &reference(&clip), TOLERANCE.on(gpu))?;
    let picture = take.renderer().clip().clone();
    let mut screenshot = Drawing::new(gpu, picture, &[whole()], ChannelDepth::Sixteen).map_err(text)?;
    let coarse = frame(&mut screenshot, 0.5)?;
    // Both further layers are on their way at once.
    let mut states = vec![reference(&clip)];
    let mut total = 0;
    for layer in [1, 2] {
        let one = std::num::NonZero::<usize>::MIN;
        let layers = head.decode_layers(&bytes[..ends[layer]], layer, &limits, one).map_err(error)?;
        let packed = PackedLayers::new(&layers, span, &layout).map_err(text)?;
        if packed.gaussians() != head.layers[layer].total() - head.layers[layer - 1].total() {
            return Err(format!("{} Gaussians in layer {layer}", packed.gaussians()));
        }
        total += packed.bytes();
        take.renderer().slots().ok_or("no take")?.append(id, packed);
        clip.append(layers);
        states.push(reference(&clip));
    }
    let (mut written, mut state) = (0, 0);
    let mut seen = vec![];
    loop {
        let slots = take.renderer().slots().ok_or("no take")?;
        let bytes = slots.upload(gpu, PIECE);
        written += bytes;
        let ready = slots.is_ready(id);
        if !slots.is_drawn(id) {
            return Err("it is not drawn".into());
        }
        let image = frame(&mut take, 0.5)?;
        // The next state, or the same.
        let is_next =
            states.get(state + 1).is_some_and(|next| next.psnr(&image) > states[state].psnr(&image));
        state += usize::from(is_next);
        check(&format!("take, layers {state}"), &image, &states[state], TOLERANCE.on(gpu))?;
        seen.push((state, ready));
        if bytes == 0 {
            break;
        }
    }
    seen.dedup();
    if seen != [(0, false), (1, false), (2, true)] || written != total {
        return Err(format!("{seen:?}, {written} of {total} bytes"));
    }
    // A picture of the first layers is that as long as it is drawn, and its room is taken as long.
    if difference(&frame(&mut screenshot, 0.5)?, &coarse).max_diff > 0.0 {
        return Err("the picture of the first layers has changed".into());
    }
    take.renderer().slots().ok_or("no take")?.remove(id);
    if insert(gpu, &mut take, (&clip, span), &layout).is_ok() {
        return Err("rows that are drawn are written again".into());
    }
    drop(screenshot);
    insert(gpu, &mut take, (&clip, span), &layout).map(|_| ())
}

/// What is removed leaves room at once; ids of segments that are gone have no effect. Static Gaussians come to rows
/// with the motion of other Gaussians.
fn room(gpu: &Gpu) -> Result<(), String> {
    let clip = clip_of(&SplitTake::new(&RECIPE, 2.0, 2.0).field);
    let dynamic = clip_of(&RECIPE.field());
    if clip.static_field.is_empty() || !dynamic.static_field.is_empty() || dynamic.len() != clip.len() {
        return Err("static and dynamic Gaussians do not change places, so this tests nothing".into());
    }
    let span = Span { start_s: 0.0, duration_s: 2.0 };
    let layout = TakeLayout::for_clip(&clip).segmented(2.0).with_rows(2 * clip.len() + clip.len() / 2);
    let mut take = drawing(gpu, layout, &[whole()])?;
    let alone = insert(gpu, &mut take, (&clip, span), &layout)?;
    let expected = frame(&mut take, 0.4)?;
    take.renderer().slots().ok_or("no take")?.remove(alone);
    let a = insert(gpu, &mut take, (&dynamic, span), &layout)?;
    let b = insert(gpu, &mut take, (&dynamic, span), &layout)?;
    let slots = take.renderer().slots().ok_or("no take")?;
    let packed = || PackedSegment::new(&clip, span, &layout).map_err(text);
    if slots.has_room(&packed()?) || slots.insert(packed()?).is_some() {
        return Err("there is room for three".into());
    }
    slots.remove(b);
    slots.remove(b);
    if slots.is_ready(b) || !slots.is_ready(a) || !slots.has_room(&packed()?) {
        return Err("the second is removed, the first is not".into());
    }
    // One that is removed while it is uploaded.
    let c = slots.insert(packed()?).ok_or("no room")?;
    slots.upload(gpu, PIECE);
    slots.remove(c);
    let d = slots.insert(packed()?).ok_or("no room")?;
    slots.remove(c);
    slots.remove(a);
    slots.upload(gpu, usize::MAX);
    if !slots.is_ready(d) || slots.is_ready(c) {
        return Err("the last is resident".into());
    }
    let found = difference(&frame(&mut take, 0.4)?, &expected);
    if found.max_diff > 0.0 { Err(format!("in other rows: {found}")) } else { Ok(()) }
}

/// A screenshot draws from another renderer, while the take plays on.
fn shared(gpu: &Gpu) -> Result<(), String> {
    let clip = clip_of(&SplitTake::new(&RECIPE, 2.0, 2.0).field);
    let other = clip_of(&SplitTake::new(&Recipe { seed: 77, ..RECIPE }, 2.0, 2.0).field);
    let span = Span { start_s: 0.0, duration_s: 2.0 };
    let layout = TakeLayout::for_clip(&clip).segmented(2.0);
    let mut take = drawing(gpu, layout, &[whole()])?;
    let id = insert(gpu, &mut take, (&clip, span), &layout)?;
    let expected = frame(&mut take, 0.4)?;
    let picture = take.renderer().clip().clone();
    let mut screenshot = Drawing::new(gpu, picture, &[whole()], ChannelDepth::Sixteen).map_err(text)?;
    take.renderer().slots().ok_or("no take")?.remove(id);
    if insert(gpu, &mut take, (&other, span), &layout).is_ok() || !is_black(&frame(&mut take, 0.4)?) {
        return Err("rows that are drawn are written again".into());
    }
    if difference(&frame(&mut screenshot, 0.4)?, &expected).max_diff > 0.0 {
        return Err("the picture of the take has changed".into());
    }
    drop(screenshot);
    insert(gpu, &mut take, (&other, span), &layout).map(|_| ())
}
