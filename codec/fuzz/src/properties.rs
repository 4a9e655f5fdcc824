//! Properties of every input of the fuzz targets. Tests of `codec` check them on the regressions.

use std::num::NonZero;
use std::ops::Range;

use codec::{
    ALPHA_MIN, Clip, ClipInfo, Coder, Contents, EncodeOptions, Error, Field, FormatError, LayerEnd, Limits,
    Poster, Precision, SH_C0, SPAN_TOLERANCE_S, SectionKind, Segment, Sensitivity, Sound, Source, Take,
    Temporal, contents, decode, encode, package, poster, sh_coefficients, with_poster, with_sound,
};

/// Limits that small, fast inputs can reach and exceed.
pub const LIMITS: Limits = Limits { max_gaussians: 1 << 14, max_bytes: 2 << 20 };

/// Largest number that the encoder accepts.
const MAGNITUDE_MAX: f32 = 1e9;

/// Largest finite FP16 number, and the smallest number that rounds to infinity.
const FP16_MAX: f32 = 65504.0;
const FP16_INFINITE: f32 = 65520.0;

/// Largest colour that the coder `rans` encodes, in steps. A coded number combines up to three channels.
const CODES: f64 = (1u32 << 22) as f64;

/// Largest number of Gaussians of an [`RoundTripInput`].
const ROWS_MAX: usize = 24;

/// Checks the result of decoding `bytes` within [`LIMITS`].
///
/// # Panics
/// If an error has no offset, or a clip breaks an invariant or contradicts its head.
pub fn check_decoding(bytes: &[u8], decoded: &Result<Clip, Error>) {
    let head = contents(bytes, &LIMITS);
    check_poster(bytes);
    if let Ok(head) = &head {
        check_sound(bytes, head);
    }
    match (decoded, &head) {
        (Ok(clip), Ok(head)) => check_clip(clip, head, &Take::from(head), bytes.len()),
        (Err(error), Ok(_)) => assert!(error.to_string().contains("at byte "), "no offset in: {error}"),
        (decoded, Err(error)) => {
            assert!(error.to_string().contains("at byte "), "no offset in: {error}");
            assert_eq!(decoded.as_ref().err(), Some(error), "the head is refused but the package is not");
        }
    }
}

/// Reads the poster of a clip or a take and checks it.
///
/// # Panics
/// If a poster is out of range, or is written as another one.
fn check_poster(bytes: &[u8]) {
    if let Ok(Some(read)) = poster(bytes, &LIMITS) {
        assert_eq!(read.check(), Ok(()), "{read:?}");
        if let Ok(written) = with_poster(bytes, Some(&read), &LIMITS) {
            // The start of a segment rounds the time.
            let again = poster(&written, &LIMITS).expect("a package").expect("a poster");
            assert_eq!(Poster { time_s: read.time_s, ..again }, read);
        }
    }
}

/// Reads the sound of a package within [`LIMITS`] and checks it.
///
/// # Panics
/// If an error has no offset in the section, or a sound breaks a rule or is written as other bytes.
pub fn check_sound(bytes: &[u8], head: &Contents) {
    let section = head.sections.iter().find(|section| section.kind == SectionKind::Sound);
    let sound = match head.sound(bytes, &LIMITS) {
        Ok(None) => return assert_eq!(section, None, "the sound vanished"),
        Ok(Some(sound)) => sound,
        Err(Error::Limits { .. }) => return,
        Err(Error::Format { offset, .. }) => {
            let section = section.expect("an error of a section");
            let is_there = (section.offset..=section.end()).contains(&offset);
            return assert!(is_there || offset == bytes.len(), "byte {offset} of {section:?}");
        }
        Err(error) => panic!("{error} is of no section"),
    };
    let again = Sound::new(*sound.info(), sound.packets());
    assert_eq!(again.as_ref(), Ok(&sound), "a sound that is read keeps the rules");
    assert_eq!(sound.packets().map(<[u8]>::len).sum::<usize>(), sound.packet_bytes());
    assert!(sound.info().end() > sound.info().start);
    let is_whole = head.sections.last().is_some_and(|section| section.end() == bytes.len());
    if is_whole {
        let written = with_sound(bytes, Some(&sound)).expect("a whole package");
        assert!(written == bytes, "the package is written as other bytes");
    }
}

/// Reads `bytes` as a clip or a take, decodes each segment that has begun within [`LIMITS`], and checks the
/// results. `segment` receives every result, by the number of the segment.
///
/// # Panics
/// If an error has no offset in its segment, a table breaks a rule, or a clip breaks an invariant or contradicts its
/// head or the take's head.
pub fn check_package(bytes: &[u8], mut segment: impl FnMut(usize, Result<Clip, Error>)) {
    let head = contents(bytes, &LIMITS);
    let is_take = Err(Error::Format { offset: 64, error: FormatError::Take });
    let take = match package(bytes, &LIMITS) {
        Err(error) => {
            assert!(error.to_string().contains("at byte "), "no offset in: {error}");
            return assert!(head == is_take || head == Err(error), "both read the same head: {head:?}");
        }
        Ok(take) => take,
    };
    match &head {
        Ok(clip) => assert_eq!(take, Take::from(clip), "both read the same head"),
        Err(_) => {
            assert_eq!(head, is_take);
            check_table(&take, bytes.len());
        }
    }
    for (index, entry) in take.segments.iter().enumerate() {
        let Some(rest) = usize::try_from(entry.offset).ok().and_then(|offset| bytes.get(offset..)) else {
            break;
        };
        let alone = &rest[..entry.bytes().min(rest.len())];
        let decoded = take.decode_segment(index, alone, &LIMITS, NonZero::<usize>::MIN);
        match &decoded {
            Ok(clip) => {
                let head = contents(alone, &LIMITS).expect("a decoded segment has a head");
                check_clip(clip, &head, &take, alone.len());
                check_prefix(clip, entry);
                check_appended(clip, &take, index, alone);
            }
            Err(Error::Format { offset, .. } | Error::Limits { offset, .. }) => {
                let range = entry.offset..=entry.offset + entry.bytes() as u64;
                assert!(range.contains(&(*offset as u64)), "byte {offset} of {range:?}");
            }
            Err(error) => panic!("{error} has an offset in another file"),
        }
        segment(index, decoded);
    }
}

/// Checks the rules of a table, in ways of its own.
fn check_table(take: &Take, available: usize) {
    assert_eq!(take.info.duration_s, take.duration_s as f32);
    assert_eq!(take.info.check(), Ok(()));
    assert!((1..=65_536).contains(&take.segments.len()));
    let mut offset = take.head_bytes as u64;
    for segment in &take.segments {
        assert_eq!(segment.offset, offset);
        offset += segment.bytes() as u64;
        assert!(
            segment.start_s < segment.end_s()
                && segment.duration_s > 0.0
                && segment.end_s().is_finite()
                && segment.start_s.is_finite()
        );
        assert!(segment.start_s < take.duration_s && segment.end_s() > 0.0, "{segment:?} is never seen");
        assert!((1..=16).contains(&segment.layers.len()));
        assert!(segment.layers.is_sorted_by(|a, b| a.bytes < b.bytes && a.gaussians < b.gaussians));
        assert!(segment.layers[0].gaussians > 0);
    }
    assert_eq!(take.package_bytes(), offset);
    assert!(available as u64 <= offset);
    let spans_take = |segment: &Segment| segment.start_s <= 0.0 && segment.end_s() >= take.duration_s;
    assert!(take.segments.is_sorted_by_key(|segment| !spans_take(segment)));
    for group in take.segments.chunk_by(|a, b| spans_take(a) == spans_take(b)) {
        assert!(group.is_sorted_by_key(|segment| (segment.start_s, -segment.duration_s)));
    }
    // The most are held where a segment begins. Limits bound the spans as they are written.
    let starts = take.segments.iter().map(|segment| segment.start_s.max(0.0));
    let residents = starts.map(|t_s| {
        let holds = |segment: &&Segment| segment.start_s <= t_s && t_s < segment.end_s();
        assert!(take.segments.iter().filter(holds).count() <= 32);
        // With the tolerance an instant is one a little later, which may be the end of all.
        assert!(take.at(t_s).count() <= 32 || t_s + 2.0 * SPAN_TOLERANCE_S >= take.duration_s);
        take.segments.iter().filter(holds).map(Segment::gaussians).sum::<usize>()
    });
    assert_eq!(residents.max(), Some(take.resident_max()));
}

/// Checks that a clip has the Gaussians that the table announces for its layers.
fn check_prefix(clip: &Clip, entry: &Segment) {
    assert_eq!(clip.layers_announced.len(), entry.layers.len());
    let plate = clip.plate.as_ref().map_or(0, Field::len);
    assert_eq!(clip.len() + plate, entry.layers[clip.layers.len() - 1].gaussians);
}

/// Checks that the layers of a clip behind the first, decoded alone and appended to the first, make the same clip.
fn check_appended(clip: &Clip, take: &Take, index: usize, alone: &[u8]) {
    if clip.layers.len() < 2 {
        return;
    }
    let (first, one) = (&alone[..take.segments[index].layers[0].bytes], NonZero::<usize>::MIN);
    let mut grown = take.decode_segment(index, first, &LIMITS, one).expect("the first layer decodes alone");
    let further = take.decode_segment_layers(index, alone, 1, &LIMITS, one);
    grown.append(further.expect("the other layers decode alone"));
    assert!(grown == *clip, "layers that are appended make another clip");
}

/// Checks the clip of a package with this head, decoded in the columns of `take`.
fn check_clip(clip: &Clip, head: &Contents, take: &Take, available: usize) {
    for field in [&clip.static_field, &clip.dynamic_field].into_iter().chain(&clip.plate) {
        field.check().expect("decoded fields are valid");
        assert_eq!(field.near, take.near);
    }
    assert_eq!((clip.static_field.sh_degree, clip.dynamic_field.sh_degree), (take.sh_degree, take.sh_degree));
    assert_eq!((clip.static_field.filter, clip.dynamic_field.filter), (take.filter, take.filter));
    assert_eq!(clip.static_field.temporal, None);
    let temporal = clip.dynamic_field.temporal.as_ref().expect("the dynamic region has temporal columns");
    assert_eq!(temporal.motion_order, take.motion_order);
    assert_eq!(temporal.rotation_rates.is_some(), take.rotation_rates);
    let plate = clip.plate.as_ref().map_or((0, None), |plate| (plate.len(), plate.temporal.as_ref()));
    assert_eq!(plate, (head.plate_len, None));
    if let Some(plate) = &clip.plate {
        assert_eq!((plate.sh_degree, plate.filter), (take.plate_sh_degree, take.plate_filter));
    }

    assert_eq!(clip.layers, head.layers[..clip.layers.len()]);
    assert_eq!(clip.layers_announced, head.layers);
    let last = LayerEnd { static_count: clip.static_field.len(), dynamic_count: clip.dynamic_field.len() };
    assert_eq!(clip.layers.last(), Some(&last));
    if head.sections.last().is_none_or(|section| section.end() <= available) {
        assert_eq!(clip.layers.len(), head.layers.len(), "a complete package has all its layers");
    }
    assert!(clip.len() + head.plate_len <= LIMITS.max_gaussians);

    for step in 0..=8 {
        let t = f64::from(step) / 8.0;
        let candidates: Vec<Range<usize>> = clip.time_index.candidates(t, clip.layers.len()).collect();
        assert!(candidates.is_sorted_by(|a, b| a.end <= b.start), "{candidates:?}");
        for i in 0..clip.dynamic_field.len() {
            assert!(clip.dynamic_field.position_at(i, t).iter().all(|x| x.is_finite()));
            if clip.dynamic_field.opacity_at(i, t) >= ALPHA_MIN {
                assert!(candidates.iter().any(|range| range.contains(&i)), "row {i} is alive at {t}");
            }
        }
    }
}

/// A source of the round trip.
#[derive(Clone, Debug, PartialEq)]
pub struct RoundTripInput {
    /// Gaussians; valid, except that numbers may be too large to package.
    pub field: Field,
    /// Ends of up to two layers before the last.
    pub layers: Vec<usize>,
    /// Whether the field without temporal columns is also the plate.
    pub plate: bool,
}

/// Reads numbers from bytes, then zeros.
struct NumberReader<'a>(std::slice::Iter<'a, u8>);

impl NumberReader<'_> {
    fn u8(&mut self) -> u8 {
        self.0.next().copied().unwrap_or(0)
    }

    fn f32(&mut self) -> f32 {
        let x = f32::from_le_bytes(std::array::from_fn(|_| self.u8()));
        if x.is_finite() { x } else { 0.0 }
    }

    fn vector<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| self.f32())
    }

    fn rotation(&mut self) -> [f32; 4] {
        let q = self.vector::<4>().map(f64::from);
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm > 0.0 { q.map(|x| (x / norm) as f32) } else { [1.0, 0.0, 0.0, 0.0] }
    }
}

impl RoundTripInput {
    /// The input that `bytes` encode: a byte each for the number of Gaussians, the columns and two ends
    /// of layers, then the numbers of each Gaussian.
    pub fn from_bytes(bytes: &[u8]) -> RoundTripInput {
        let mut numbers = NumberReader(bytes.iter());
        let rows = 1 + usize::from(numbers.u8()) % ROWS_MAX;
        let columns = numbers.u8();
        let mut layers = [numbers.u8(), numbers.u8()].map(|end| usize::from(end) % rows).to_vec();
        layers.sort_unstable();
        layers.dedup();
        layers.retain(|end| *end > 0);
        let sh_degree = columns & 3;
        let mut field = Field { sh_degree, ..Field::default() };
        let mut temporal = Temporal { motion_order: columns >> 2 & 3, ..Temporal::default() };
        temporal.rotation_rates = (columns & 0x10 != 0).then(Vec::new);
        field.temporal = (columns & 0x20 != 0).then_some(temporal);
        for _ in 0..rows {
            field.centers.push(numbers.vector());
            field.rotations.push(numbers.rotation());
            field.log_scales.push(numbers.vector());
            field.opacities.push(numbers.f32().abs().min(1.0));
            field.sh.extend((0..sh_coefficients(sh_degree)).map(|_| numbers.vector::<3>()));
            if let Some(temporal) = &mut field.temporal {
                temporal.tau.push(numbers.f32());
                let s = numbers.f32().abs();
                temporal.s.push(if s > 0.0 { s } else { f32::INFINITY });
                temporal.motion.extend((0..temporal.motion_order).map(|_| numbers.vector::<3>()));
                if let Some(rates) = &mut temporal.rotation_rates {
                    rates.push(numbers.vector());
                }
            }
        }
        RoundTripInput { field, layers, plate: columns & 0x40 != 0 }
    }

    /// The bytes of this input of at most [`ROWS_MAX`] Gaussians, for [`RoundTripInput::from_bytes`].
    pub fn to_bytes(&self) -> Vec<u8> {
        let field = &self.field;
        let temporal = field.temporal.as_ref();
        let rates = temporal.and_then(|temporal| temporal.rotation_rates.as_ref());
        let layer = |k: usize| self.layers.get(k).map_or(0, |end| *end as u8);
        let columns = field.sh_degree
            | field.motion_order() << 2
            | u8::from(rates.is_some()) << 4
            | u8::from(temporal.is_some()) << 5
            | u8::from(self.plate) << 6;
        let mut bytes = vec![(field.len() - 1) as u8, columns, layer(0), layer(1)];
        let mut numbers = |numbers: &[f32]| bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        for i in 0..field.len() {
            numbers(&field.centers[i]);
            numbers(&field.rotations[i]);
            numbers(&field.log_scales[i]);
            numbers(&[field.opacities[i]]);
            numbers(field.sh_of(i).as_flattened());
            if let Some(temporal) = temporal {
                numbers(&[temporal.tau[i], temporal.s[i]]);
                numbers(temporal.motion_of(i).as_flattened());
                numbers(rates.map_or(&[], |rates| &rates[i]));
            }
        }
        bytes
    }
}

/// Packages the input that `bytes` encode with every coder, and decodes it.
///
/// # Panics
/// If a valid field is refused, the package differs between two runs, or the decoded clip is invalid or
/// too far from the source.
pub fn check_round_trip(bytes: &[u8]) {
    let RoundTripInput { field, layers, plate } = RoundTripInput::from_bytes(bytes);
    let plate = plate.then(|| Field { temporal: None, ..field.clone() });
    let info = ClipInfo::default();
    let source = Source { info: &info, field: &field, plate: plate.as_ref() };
    for coder in Coder::ALL {
        let mut options = EncodeOptions { coder, ..EncodeOptions::default() };
        options.layers.clone_from(&layers);
        let package = encode(&source, &options);
        assert_eq!(package, encode(&source, &options), "encoding is deterministic");
        let package = match package {
            Ok(package) if !exceeds_magnitude(&field) => package,
            Err(_) if exceeds_magnitude(&field) => continue,
            // The coder `rans` moves windows that are far from the clip.
            Err(_) if coder != Coder::Fixed && has_infinite_bounds(&field) => continue,
            other => panic!("numbers too large: {}, encoding gives {other:?}", exceeds_magnitude(&field)),
        };
        let decoded = decode(&package, &LIMITS);
        check_decoding(&package, &decoded);
        let clip = decoded.expect("an encoded package decodes");
        assert_eq!(clip.info, info);
        assert_eq!(clip.layers.len(), layers.len() + 1);
        let mut start = LayerEnd::default();
        for (k, end) in clip.layers.iter().enumerate() {
            let first = if k == 0 { 0 } else { layers[k - 1] };
            let last = layers.get(k).copied().unwrap_or(field.len());
            let static_rows =
                clip.static_field.select(&(start.static_count..end.static_count).collect::<Vec<_>>());
            let dynamic_rows =
                clip.dynamic_field.select(&(start.dynamic_count..end.dynamic_count).collect::<Vec<_>>());
            check_rows(
                coder,
                &field.select(&(first..last).collect::<Vec<_>>()),
                &[&static_rows, &dynamic_rows],
            );
            start = *end;
        }
        if let Some(plate) = &plate {
            check_rows(coder, plate, &[clip.plate.as_ref().expect("a plate that is not empty")]);
        }
    }
    check_steps(&source);
}

/// Packages `source` with the coder `rans` and equal sensitivities, so that all Gaussians have one
/// known step, and checks the errors of opacities and colours.
///
/// # Panics
/// If one exceeds its bound.
fn check_steps(source: &Source) {
    let Source { field, .. } = *source;
    let sensitivities = vec![Sensitivity { color: 1.0, geometry: 1.0 }; field.len()];
    let precision = Precision { psnr: 50.7, sensitivities, ..Precision::default() };
    let options = EncodeOptions { coder: Coder::Rans, precision, ..EncodeOptions::default() };
    let Ok(package) = encode(&Source { plate: None, ..*source }, &options) else {
        // Numbers too large, as the round trip has checked.
        return;
    };
    let clip = decode(&package, &LIMITS).expect("an encoded package decodes");
    let head = contents(&package, &LIMITS).expect("a decoded package has a head");
    let chunks = head.sections.iter().map(|section| &package[section.offset..section.end()]);
    // A chunk starts with its step; each region is one chunk, and all have the same step.
    let step = chunks.map(|chunk| f32::from_le_bytes([chunk[0], chunk[1], chunk[2], chunk[3]]));
    let step = f64::from(step.fold(0.0, f32::max));
    let parts = [&clip.static_field, &clip.dynamic_field];
    let color_max = CODES * (1.45 * step).min(0.5) / SH_C0;
    for i in 0..field.len() {
        if field.sh_of(i).as_flattened().iter().any(|x| f64::from(x.abs()) > color_max) {
            continue;
        }
        let rows = || parts.iter().flat_map(|&part| (0..part.len()).map(move |j| (part, j)));
        let found = rows().any(|(part, j)| appearance_holds(step, field, i, part, j));
        assert!(found, "row {i} of {field:?}\nhas no match within steps of {step} in {parts:?}");
    }
}

/// Whether the clip shows row `i` although its window is centred outside.
fn shows_tail(field: &Field, i: usize) -> bool {
    let is_outside =
        |temporal: &Temporal| temporal.s[i].is_finite() && !(0.0..=1.0).contains(&temporal.tau[i]);
    field.temporal.as_ref().is_some_and(is_outside) && field.alive_interval(i).is_some()
}

/// Whether opacity and colours of decoded row `j` may come from source row `i`, for quantiser indices
/// of 0 and the step `step` of a chunk.
fn appearance_holds(step: f64, source: &Field, i: usize, decoded: &Field, j: usize) -> bool {
    // Where the clip shows a tail of a window alone, the opacity makes up for the rounding of the window: what shows is close. A
    // row that became static keeps its opacity.
    let is_tail = decoded.temporal.is_some() && shows_tail(source, i);
    let shown = |field: &Field, row: usize| match &field.temporal {
        Some(temporal) if is_tail => field.opacity_at(row, f64::from(temporal.tau[row]).clamp(0.0, 1.0)),
        _ => f64::from(field.opacities[row]),
    };
    // Rounding keeps visible opacities visible and invisible opacities invisible: up to a step more.
    let off = [shown(source, i), shown(decoded, j)].map(|x| x.max(0.5 * ALPHA_MIN).ln());
    let steps = if is_tail { 3.0 } else { 1.5 };
    // A window of less than a thousand of the finest steps of its centre is off by its own width.
    let is_instant = |temporal: &Temporal| temporal.s[i] < 1e-3;
    let opacity_holds = (off[0] - off[1]).abs() <= steps * (1.2 * step).min(0.4) + 1e-5
        || is_tail && source.temporal.as_ref().is_some_and(is_instant);
    // Half a step of luma and a quarter of each difference. Harmonics are three orthogonal numbers,
    // which may be rounded by up to a step.
    let luma = (1.45 * step).min(0.5);
    let chroma = (1.45 * 1.6 * step).min(0.5);
    let color = (0.5 * luma + 0.5 * chroma) / SH_C0;
    let harmonic = 3f64.sqrt() * 1.8 * step / SH_C0;
    let colors_hold = (0..sh_coefficients(source.sh_degree)).all(|k| {
        let expected = source.sh_of(i)[k];
        let size = expected.iter().fold(0.0, |size: f64, x| size.max(f64::from(x.abs())));
        let actual = decoded.sh_of(j).get(k).copied().unwrap_or_default();
        near(&expected, &actual, if k == 0 { color } else { harmonic } + rounding(size))
    });
    opacity_holds && colors_hold
}

/// Whether a number of the field is too large to package.
fn exceeds_magnitude(field: &Field) -> bool {
    let temporal = field.temporal.as_ref();
    let motion = temporal.map_or(&[][..], |temporal| &temporal.motion);
    let rates = temporal.and_then(|temporal| temporal.rotation_rates.as_deref()).unwrap_or_default();
    let vectors = field.centers.iter().chain(&field.log_scales).chain(&field.sh).chain(motion);
    vectors.flatten().chain(rates.as_flattened()).any(|x| x.abs() > MAGNITUDE_MAX)
}

/// Whether the bounds of the field are infinite.
fn has_infinite_bounds(field: &Field) -> bool {
    let [low, high] = field.bounds();
    (0..3).any(|axis| !(high[axis] - low[axis]).is_finite())
}

/// Checks that `parts` are the rows of `source` in any order, within the error bounds of the coder
/// `fixed`.
fn check_rows(coder: Coder, source: &Field, parts: &[&Field]) {
    assert_eq!(parts.iter().map(|part| part.len()).sum::<usize>(), source.len());
    if coder != Coder::Fixed {
        return;
    }
    let bounds = ErrorBounds::new(source);
    let decoded = || parts.iter().flat_map(|&part| (0..part.len()).map(move |i| (part, i)));
    let mut cut_rows = 0;
    for i in 0..source.len() {
        let found = |cut| decoded().any(|(part, j)| bounds.hold(source, i, part, j, cut));
        assert!(found(Cut::Allowed), "row {i} of {source:?}\nhas no match in {parts:?}");
        cut_rows += usize::from(!found(Cut::Forbidden));
    }
    for (part, j) in decoded() {
        let found = (0..source.len()).any(|i| bounds.hold(source, i, part, j, Cut::Allowed));
        assert!(found, "row {j} of {part:?}\nhas no match in {source:?}");
    }
    // Each range of a chunk leaves out the numbers of a 64th of the rows, or of one row; each may be of another row.
    let order = source.temporal.as_ref().map_or(0, |temporal| usize::from(temporal.motion_order));
    let numbers = 3 * sh_coefficients(source.sh_degree) + 3 * order + 4;
    assert!(
        cut_rows <= numbers * (source.len() / 64 + 2),
        "{cut_rows} rows of {source:?}\nare cut in {parts:?}"
    );
}

/// Whether the range of a column may leave a number out, which then becomes the nearest that it holds.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Cut {
    Allowed,
    Forbidden,
}

/// Largest errors of the coder `fixed` on a chunk, from the table in FORMAT.md. A chunk with fewer rows
/// has narrower ranges and smaller errors.
struct ErrorBounds {
    center: f64,
    log_scale: f64,
    /// Lower log-scales may be raised to this.
    log_scale_floor: f64,
    /// Per degree.
    sh: [f64; 4],
    /// Per power of time, from 1.
    motion: [f64; 3],
    rate: f64,
}

impl ErrorBounds {
    fn new(rows: &Field) -> ErrorBounds {
        let extent = (0..3).map(|axis| span(rows.centers.iter().map(|c| c[axis]))).fold(0.0, f64::max);
        let log_scales = || rows.log_scales.as_flattened().iter().copied();
        let band = |degree: u8| {
            let count = sh_coefficients(degree.max(1) - 1) * usize::from(degree > 0)..sh_coefficients(degree);
            (0..rows.len()).flat_map(move |i| rows.sh_of(i)[count.clone()].iter().flatten().copied())
        };
        let half_step =
            |steps: f64, largest: f64, finest: f64| 0.501 * (largest / steps).max(finest) + rounding(largest);
        let mut bounds = ErrorBounds {
            center: extent / 4096.0 + rounding(largest(rows.centers.iter().flatten().copied())),
            log_scale: 0.501 * span(log_scales()).min(16.0) / 255.0 + rounding(largest(log_scales())),
            log_scale_floor: log_scales().fold(f64::MIN, |high, x| high.max(x.into())) - 16.0,
            sh: [0.501 * span(band(0)) / 255.0 + rounding(largest(band(0))), 0.0, 0.0, 0.0],
            motion: [0.0; 3],
            rate: 0.0,
        };
        for degree in 1..=rows.sh_degree {
            bounds.sh[usize::from(degree)] = half_step(127.0, largest(band(degree)), 1.0 / 1024.0);
        }
        if let Some(temporal) = &rows.temporal {
            let order = usize::from(temporal.motion_order);
            for power in 0..order {
                let column = temporal.motion.iter().skip(power).step_by(order).flatten().copied();
                bounds.motion[power] = half_step(511.0, largest(column), extent * 2f64.powi(-20));
            }
            let rates = temporal.rotation_rates.as_deref().unwrap_or_default();
            bounds.rate = half_step(127.0, largest(rates.as_flattened().iter().copied()), 1.0 / 512.0);
        }
        bounds
    }

    /// Whether decoded row `j` may be source row `i`.
    fn hold(&self, source: &Field, i: usize, decoded: &Field, j: usize, cut: Cut) -> bool {
        let scales = source.log_scales[i].iter().zip(&decoded.log_scales[j]);
        let scales_hold = scales.into_iter().all(|(&e, &a)| {
            let (e, a) = (f64::from(e), f64::from(a));
            (e - self.log_scale..=e.max(self.log_scale_floor) + self.log_scale).contains(&a)
        });
        let (expected, actual) = (source.rotations[i], decoded.rotations[j]);
        // A quaternion and its negative are one rotation; the rates have the same sign.
        let sign = (0..4).map(|k| expected[k] * actual[k]).sum::<f32>().signum();
        let coefficient =
            |field: &Field, row: usize, k: usize| field.sh_of(row).get(k).copied().unwrap_or_default();
        let colors_hold = (0..sh_coefficients(source.sh_degree)).all(|k| {
            let degree = k.isqrt();
            ranged(&coefficient(source, i, k), &coefficient(decoded, j, k), self.sh[degree], cut)
        });
        near(&source.centers[i], &decoded.centers[j], self.center)
            && scales_hold
            && near(&expected.map(|x| sign * x), &actual, 0.01)
            && near(&[source.opacities[i]], &[decoded.opacities[j]], 1.0 / 510.0 + 1e-6)
            && decoded.sh_degree <= source.sh_degree
            && colors_hold
            && self.time_holds(source, i, decoded, j, (sign, cut))
    }

    fn time_holds(
        &self,
        source: &Field,
        i: usize,
        decoded: &Field,
        j: usize,
        (sign, cut): (f32, Cut),
    ) -> bool {
        let Some(expected) = &source.temporal else {
            return decoded.temporal.as_ref().is_none_or(|temporal| temporal.s[j].is_infinite());
        };
        // Windows are cut to the range of FP16.
        let tau = expected.tau[i].clamp(-FP16_MAX, FP16_MAX);
        let s = if expected.s[i] < FP16_INFINITE { expected.s[i] } else { f32::INFINITY };
        let Some(actual) = &decoded.temporal else {
            // Drawn as constant: half an 8-bit step, and half a step for rounding the opacity.
            let is_constant = |t: f64| {
                let z = (t - f64::from(tau)) / f64::from(s);
                let opacity = f64::from(source.opacities[i]) * (-0.5 * z * z).exp();
                (opacity - f64::from(decoded.opacities[j])).abs() <= 1.0 / 255.0 + 1e-5
            };
            return expected.is_motionless(i) && [0.0, 0.5, 1.0].into_iter().all(is_constant);
        };
        let half = |x: f32| f64::from(x.abs()) * 2f64.powi(-11) + 2f64.powi(-24);
        let power = |temporal: &Temporal, row: usize, k: usize| {
            temporal.motion_of(row).get(k).copied().unwrap_or_default()
        };
        let rate = |temporal: &Temporal, row: usize| {
            temporal.rotation_rates.as_ref().map_or([0.0; 4], |rates| rates[row])
        };
        near(&[tau], &[actual.tau[j]], half(tau))
            && (s == actual.s[j] || near(&[s], &[actual.s[j]], half(s)))
            && (0..3).all(|k| ranged(&power(expected, i, k), &power(actual, j, k), self.motion[k], cut))
            && ranged(&rate(expected, i).map(|x| sign * x), &rate(actual, j), self.rate, cut)
    }
}

/// Rounding error of a few binary32 operations on numbers up to `largest`.
fn rounding(largest: f64) -> f64 {
    2f64.powi(-21) * largest + f64::from(f32::MIN_POSITIVE)
}

fn largest(column: impl Iterator<Item = f32>) -> f64 {
    column.fold(0.0, |largest, x| largest.max(x.abs().into()))
}

/// Difference of the largest and the smallest number of a column.
fn span(column: impl Iterator<Item = f32>) -> f64 {
    let (low, high) =
        column.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x.into()), high.max(x.into())));
    high - low
}

fn near(expected: &[f32], actual: &[f32], error: f64) -> bool {
    expected.iter().zip(actual).all(|(e, a)| (f64::from(*e) - f64::from(*a)).abs() <= error)
}

/// As [`near`]; a number that was cut is nearer to 0.
fn ranged(expected: &[f32], actual: &[f32], error: f64, cut: Cut) -> bool {
    let holds = |(e, a): (&f32, &f32)| {
        let (e, a) = (f64::from(*e), f64::from(*a));
        let is_cut = cut == Cut::Allowed && a * e.signum() >= -error && a.abs() <= e.abs();
        is_cut || (e - a).abs() <= error
    };
    expected.iter().zip(actual).all(holds)
}
