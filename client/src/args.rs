//! The command line.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use clap::Parser;
use glam::UVec2;
#[cfg(not(target_os = "android"))]
use program::generate::GenerateOption;
use program::{Fault, Lens, Standpoint};

use crate::content::{SourceOptions, is_url};
use crate::gpu::{ChannelDepth, Cutoff, Level, RenderSettings, SortOrder};

/// The text of `--version`: versions of the program and of the packages that it plays.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    format!("{}\nplays packages (.aarc) of version {}.x", env!("CARGO_PKG_VERSION"), codec::VERSION_MAJOR)
});

/// The end of the long help.
const AFTER_HELP: &str = "\
Exit codes:
  0  done
  1  a defect of the program
  2  the command line asks for something impossible, or an output cannot be written
  3  a clip or camera file is missing, damaged or of another format
  4  a clip could not be fetched
  5  there is no display or graphics device, or it failed

  An error is one line on standard error: what is wrong, where, and what to do. Outputs are written
  completely or not at all. Shells report 130 after Ctrl-C.

Environment:
  XDG_CACHE_HOME        folder of aarc/clips, the cache of downloads, 512 MiB at most
                        [default: ~/.cache; macOS: ~/Library/Caches; Windows: %LOCALAPPDATA%]
  XDG_STATE_HOME        folder of aarc/placements.json, the places of clips in the room,
                        aarc/sound.json, the volume, and aarc/recent.json, the clips
                        opened last
                        [default: ~/.local/state; macOS: ~/Library/Application Support;
                        Windows: %APPDATA%]
  SSL_CERT_FILE         certificates to trust [default: Mozilla's]
  HTTPS_PROXY, HTTP_PROXY, ALL_PROXY, NO_PROXY
                        the proxy for URLs [default: none]
  XR_RUNTIME_JSON       the OpenXR runtime [default: the system's]
  RUST_LOG              what to log, such as \"info\" or \"client=debug\"
                        [default: error,wgpu_hal=off]

Examples:
  aarc clip.aarc
  aarc monday.aarc tuesday.aarc
  aarc scene.ply
  aarc https://clips.example.org/dance.aarc
  aarc clip.aarc --headless --time 0.5 --size 1024x1024 --out frame.png
  aarc clip.aarc --headless --frames 0..30 --fps 30 --stereo --out frames --stats stats.json
  aarc --xr clip.aarc
  aarc --generate bash > ~/.local/share/bash-completion/completions/aarc";

/// Plays a clip of 4D Gaussians in a window or a headset, or renders images of it.
#[derive(Clone, Debug, Parser)]
#[command(name = "aarc", version, long_version = VERSION.as_str(), after_long_help = AFTER_HELP)]
pub struct Args {
    /// Clips (.aarc) and playlists of clips (.json), as paths or as http:// or https:// URLs, and folders of clips:
    /// several are one playlist [default: the built-in demo]. Built with the feature formats, also the path of a field
    /// that aarc-studio package reads (.ply, .spz, .sog, .splat and others), of a folder with one, or of a folder of
    /// numbered fields, one a frame; a folder with clips plays the clips.
    ///
    /// A clip from a URL plays as soon as its first layer has arrived. Downloads are cached in
    /// $XDG_CACHE_HOME/aarc/clips and play from there without the network. The cache holds 512 MiB; the
    /// clips played longest ago are removed first. SSL_CERT_FILE names certificates to trust instead of
    /// Mozilla's; HTTPS_PROXY and HTTP_PROXY name a proxy.
    #[arg(value_name = "CLIP")]
    pub clips: Vec<String>,

    /// Render to images instead of opening a window.
    #[arg(long, requires = "out", group = "windowless")]
    pub headless: bool,

    /// Play in a headset through OpenXR instead of opening a window.
    #[arg(long, groups = ["windowless", "worn"], conflicts_with_all = ["size", "view", "fps"])]
    pub xr: bool,

    /// Image to write, a PNG; with --frames or several times, folder for images (frame_0000.png, ...). With
    /// --xr: folder for the last frame of --frames as both eyes saw it (left.png, right.png) and the cameras with the time in seconds
    /// (left.json, right.json) [default with --xr: no images].
    #[arg(long, value_name = "PATH", requires = "windowless")]
    pub out: Option<PathBuf>,

    /// Times to render, in seconds from the start of the clip [default: 0].
    #[arg(
        long,
        value_name = "S[,S..]",
        value_delimiter = ',',
        value_parser = finite,
        allow_negative_numbers = true,
        requires = "headless"
    )]
    pub time: Vec<f64>,

    /// Render the poster of the clip, the time and view that stand for it in file managers [default of a clip without
    /// one: its first viewpoint at 0 s].
    #[arg(long, requires = "headless", conflicts_with_all = ["time", "frames", "view", "camera", "worn"])]
    pub poster: bool,

    /// Frames to render: A to B - 1, frame i at i / fps seconds [default: those of --time]. With --xr: quit
    /// after B frames of the clip, and leave the first A out of the statistics [default: play until
    /// closed].
    #[arg(long, value_name = "A..B", value_parser = frames, requires = "windowless", conflicts_with = "time")]
    pub frames: Option<Range<u32>>,

    /// Quit after the clip was shown for two seconds, which the statistics leave out, and then for S seconds. Quality
    /// follows the headset as in any session [default: play until closed].
    // With --headless, --xr is excluded and thus not required.
    #[arg(long, value_name = "S", value_parser = duration, requires = "xr", conflicts_with_all = ["frames", "headless"])]
    pub seconds: Option<f64>,

    /// Frames per second of --frames [default: the frame rate of the capture].
    #[arg(long, value_name = "F", value_parser = rate, requires = "frames")]
    pub fps: Option<f64>,

    /// Size of the image or the window in pixels; with --stereo, of one eye [default: that of --camera,
    /// else 1280x720].
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<UVec2>,

    /// Render a left and a right eye side by side, 63 mm apart.
    #[arg(long, requires = "headless")]
    pub stereo: bool,

    /// Render both eyes as this headset shows them: with its angles, in images of the size that it recommends
    /// unless --size says otherwise.
    #[arg(
        long,
        value_enum,
        value_name = "HEADSET",
        requires = "headless",
        group = "worn",
        conflicts_with_all = ["camera", "stereo"]
    )]
    pub lens: Option<Lens>,

    /// With --lens or --xr: stand 0.7 m in front of the middle of the content [default with --lens: at --view; with
    /// --xr: where the clip was left, else in front of it].
    #[arg(long, requires = "worn", group = "standpoint")]
    pub near: bool,

    /// With --lens or --xr: stand 2 m in front of the middle of the content.
    #[arg(long, requires = "worn", group = "standpoint")]
    pub standing: bool,

    /// With --lens or --xr: stand in the middle of the content and look level in the direction of the first viewpoint.
    #[arg(long, requires = "worn", group = "standpoint")]
    pub inside: bool,

    /// Draw only the middle of an image at full resolution, F of its sides, 0.1 to 0.9, and everything else at F of the
    /// resolution; 0 draws everything at full resolution.
    #[arg(long, value_name = "F", value_parser = inset, default_value = "0", requires = "headless")]
    pub inset: f32,

    /// Viewpoint of the clip, by name or by number from 0 [default: the first].
    #[arg(long, value_name = "NAME|INDEX", conflicts_with_all = ["camera", "standpoint"])]
    pub view: Option<String>,

    /// Camera file with OpenCV axes: {"width", "height", "K": 3x3, "world_to_camera": 4x4} [default: the
    /// camera of --view].
    #[arg(long, value_name = "FILE.json", requires = "headless")]
    pub camera: Option<PathBuf>,

    /// Axis of a field of another program that points up: x, y, z, -x, -y or -z [default: what the file or its scene.json
    /// says, else -y]. A package states its own.
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true)]
    pub up: Option<[i8; 3]>,

    /// Draw only the first N layers, the most important ones [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub layer: Option<u32>,

    /// Sort key: depth along the view axis, or radial distance from the eye [default: depth; with --xr:
    /// radial].
    #[arg(long, value_enum)]
    pub sort: Option<SortOrder>,

    /// Support radius of a Gaussian: to where its alpha falls to 1/255, or at most sqrt(8) or sqrt(5)
    /// sigma.
    #[arg(long, value_enum, default_value_t)]
    pub cutoff: Cutoff,

    /// Highest quality level in a headset; the player chooses a lower one where the GPU misses frames. With
    /// --frames: the level of all frames.
    // With --headless, --xr is excluded and thus not required.
    #[arg(
        long,
        value_enum,
        default_value_t,
        value_name = "LEVEL",
        requires = "xr",
        conflicts_with = "headless"
    )]
    pub quality: Level,

    /// Bits per channel of the render target: 8, as a display has, or 16, which keeps small contributions.
    /// Image files have 8.
    #[arg(long, value_enum, default_value = "16", requires = "headless")]
    pub target: ChannelDepth,

    /// Write counts and timings as JSON [default: none].
    #[arg(long, value_name = "FILE.json", requires = "windowless")]
    pub stats: Option<PathBuf>,

    /// The document to print instead.
    #[cfg(not(target_os = "android"))]
    #[command(flatten)]
    pub generate: GenerateOption,
}

impl Args {
    /// Refuses options that have no effect on what is named.
    ///
    /// # Errors
    /// [`Fault::Usage`] for `--up` where every name is that of a package.
    pub fn check(&self) -> Result<(), Fault> {
        let is_package = |name: &String| {
            let extension = Path::new(name).extension();
            is_url(name) || extension.is_some_and(|extension| extension.eq_ignore_ascii_case("aarc"))
        };
        match self.up {
            Some(_) if self.clips.iter().all(is_package) => Err(Fault::Usage(
                "--up is the axis of a field of another program, and a package states its own: leave it out"
                    .into(),
            )),
            _ => Ok(()),
        }
    }

    /// Options of sources; downloads are cached in `cache_dir`.
    pub(crate) fn source(&self, cache_dir: Option<PathBuf>) -> SourceOptions {
        SourceOptions { cache_dir, up: self.up, ..SourceOptions::default() }
    }

    /// Where the wearer of the headset stands; `None` for no choice.
    pub(crate) fn standpoint(&self) -> Option<Standpoint> {
        let standpoints = [
            (self.near, Standpoint::Near),
            (self.standing, Standpoint::Standing),
            (self.inside, Standpoint::Inside),
        ];
        standpoints.into_iter().find_map(|(is_chosen, standpoint)| is_chosen.then_some(standpoint))
    }

    /// The renderer's settings.
    pub fn settings(&self) -> RenderSettings {
        // Turning the head must not change the order.
        let default_sort = if self.xr { SortOrder::Radial } else { SortOrder::Depth };
        RenderSettings {
            sort: self.sort.unwrap_or(default_sort),
            cutoff: self.cutoff,
            layers: self.layer.map(|layers| layers as usize),
            inset: (self.inset > 0.0).then_some(self.inset),
        }
    }
}

fn inset(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(side) if side == 0.0 || (0.1..=0.9).contains(&side) => Ok(side),
        _ => Err("not 0, nor a number from 0.1 to 0.9".into()),
    }
}

fn axis(text: &str) -> Result<[i8; 3], String> {
    let (sign, name) = text.strip_prefix('-').map_or((1, text), |name| (-1, name));
    let unit = ["x", "y", "z"].map(|axis| if axis == name { sign } else { 0 });
    if unit == [0; 3] { Err("not one of x, y, z, -x, -y, -z".into()) } else { Ok(unit) }
}

fn finite(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err("not a finite number of seconds".into()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("not a positive number of frames per second".into()),
    }
}

fn duration(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("not a positive number of seconds".into()),
    }
}

fn frames(text: &str) -> Result<Range<u32>, String> {
    let range = text.split_once("..").and_then(|(a, b)| Some(a.parse().ok()?..b.parse().ok()?));
    range.filter(|range| !range.is_empty()).ok_or("not a range A..B with A below B".into())
}

fn size(text: &str) -> Result<UVec2, String> {
    let size = text.split_once('x').and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
    size.filter(|size| size.min_element() > 0).ok_or("not a size WxH of at least 1x1 pixels".into())
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, ValueEnum};

    use super::*;

    fn parse(line: &str) -> Result<Args, clap::Error> {
        Args::try_parse_from(line.split(' '))
    }

    #[test]
    fn definition_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn options_are_parsed() {
        let args = parse(
            "aarc a.aarc --headless --out o --time 0,0.5,1 --size 64x32 --stereo --view front --layer 2 \
             --sort radial --cutoff 5 --target 16 --stats s.json",
        )
        .unwrap();
        assert_eq!(args.time, [0.0, 0.5, 1.0]);
        assert_eq!(args.size, Some(UVec2::new(64, 32)));
        assert_eq!(args.target, ChannelDepth::Sixteen);
        let settings = args.settings();
        assert_eq!((settings.sort, settings.cutoff), (SortOrder::Radial, Cutoff::Sqrt5));
        assert_eq!(settings.layers, Some(2));
        let frames = parse("aarc a --headless --out o --frames 2..5 --fps 12.5").unwrap();
        assert_eq!((frames.frames, frames.fps), (Some(2..5), Some(12.5)));
        let ups = ["y", "-z"].map(|axis| parse(&format!("aarc a --up {axis}")).unwrap().up);
        assert_eq!(ups, [Some([0, 1, 0]), Some([0, 0, -1])]);
    }

    #[test]
    fn invalid_values_are_refused() {
        for tail in [
            "--time nan",
            "--time inf",
            "--time 0,x",
            "--size 0x0",
            "--size 10",
            "--size -1x5",
            "--frames 3..3",
            "--frames 5..2",
            "--frames 1..2 --time 0",
            "--frames 0..2 --fps 0",
            "--frames 0..2 --fps nan",
            "--fps 5",
            "--layer 0",
            "--up w",
            "--up --",
            "--cutoff 9",
            "--target 32",
            "--sort none",
            "--view a --camera b",
            "--quality least",
        ] {
            assert!(parse(&format!("aarc a --headless --out o {tail}")).is_err(), "{tail}");
        }
        assert!(parse("aarc a --headless").is_err(), "headless needs an output");
        assert!(parse("aarc a --out o").is_err(), "a window writes no images");
        for line in
            ["--xr --headless --out o", "--xr --time 0", "--xr --frames 0..9 --fps 3", "--xr --size 9x9"]
        {
            assert!(parse(&format!("aarc a {line}")).is_err(), "{line}");
        }
        for line in [
            "--seconds 5",
            "--headless --out o --seconds 5",
            "--xr --seconds 0",
            "--xr --seconds 5 --frames 0..9",
        ] {
            assert!(parse(&format!("aarc a {line}")).is_err(), "{line}");
        }
    }

    #[test]
    fn several_names_are_one_list() {
        assert_eq!(
            parse("aarc a.aarc b.json https://h/c.aarc").unwrap().clips,
            ["a.aarc", "b.json", "https://h/c.aarc"]
        );
        assert!(parse("aarc").unwrap().clips.is_empty() && parse("aarc a b --xr").unwrap().clips.len() == 2);
    }

    #[test]
    fn the_axis_of_a_field_is_of_no_package() {
        let is_refused = |names: &str| parse(&format!("aarc{names} --up y")).unwrap().check().is_err();
        assert!(
            ["", " a.aarc", " a.AARC b.aarc", " https://h/a"].map(is_refused).iter().all(|refused| *refused)
        );
        // A folder or a playlist may have one.
        assert!(![" a.ply", " a.aarc a.ply", " a", " a.json"].map(is_refused).iter().any(|refused| *refused));
        assert!(parse("aarc a.aarc").unwrap().check().is_ok());
    }

    #[test]
    fn only_the_wearer_of_a_headset_has_a_standpoint() {
        for line in ["--xr --near", "--xr --seconds 60 --near", "--headless --out o --lens quest3 --near"] {
            let args = parse(&format!("aarc a {line}")).unwrap();
            assert_eq!(args.standpoint(), Some(Standpoint::Near), "{line}");
        }
        for line in ["--near", "--headless --out o --near", "--xr --near --inside", "--xr --lens quest3"] {
            assert!(parse(&format!("aarc a {line}")).is_err(), "{line}");
        }
    }

    #[test]
    fn every_generated_document_knows_every_option() {
        use program::generate::{Generated, render};

        for &document in Generated::value_variants() {
            let text = String::from_utf8(render(document, Args::command())).expect("text");
            // Without the man page's markup of fonts and dashes.
            let plain = text.replace(r"\fR", "").replace('\\', "");
            let dashes = if document == Generated::Fish { "-l " } else { "--" };
            for option in Args::command().get_arguments().filter_map(|option| option.get_long()) {
                let option = format!("{dashes}{option}");
                // A longer option may begin with the same letters.
                let mut ends = plain.match_indices(&option).map(|(at, _)| &plain[at + option.len()..]);
                let is_longer = |c: char| c == '-' || c.is_alphanumeric();
                assert!(ends.any(|rest| !rest.starts_with(is_longer)), "{document:?} lacks {option}");
            }
        }
        let page = String::from_utf8(render(Generated::Man, Args::command())).expect("text");
        assert!(page.contains(".SH OPTIONS") && page.contains("Exit codes"), "{page}");
        assert!(AFTER_HELP.contains(&format!("[default: {}]", crate::gpu::LOG_FILTER)), "{AFTER_HELP}");
    }

    #[test]
    fn a_headset_sorts_by_distance_from_the_eye() {
        let sort = |line: &str| parse(line).unwrap().settings().sort;
        assert_eq!(sort("aarc a"), SortOrder::Depth);
        assert_eq!(sort("aarc a --xr"), SortOrder::Radial);
        assert_eq!(sort("aarc a --xr --sort depth --frames 0..9 --out o --stats s"), SortOrder::Depth);
    }
}
