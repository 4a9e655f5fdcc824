//! Writes a rig as a folder of videos with a calibration and the truth, whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use program::Fault;
use program::output::{self, OutputFolder};
use rayon::prelude::*;

use super::calibration::calibration;
use super::display_matrix::turn_clockwise;
use super::encode::{Encoding, VideoFormat};
use super::sensor::on_its_side;
use super::sound::{Microphone, RATE};
use super::truth;
use super::view::{Rig, RigPicture};
use crate::synth::stage::{mask_png, name};

/// Frames that each thread traces before they are encoded.
const BATCH_PER_THREAD: usize = 2;

/// Writes the rig to `folder`, at which there is nothing or an empty folder. Calls `on_picture` after each picture.
///
/// # Errors
/// [`Fault::Usage`] if ffmpeg is not installed or `folder` cannot be written.
pub fn write(folder: &Path, rig: &Rig, mut on_picture: impl FnMut()) -> Result<(), Fault> {
    let output = OutputFolder::begin(folder)?;
    for camera in 0..rig.cameras.len() {
        write_camera(&Target { folder, temporary: output.path() }, rig, camera, &mut on_picture)?;
    }
    output.write("calibration.toml", calibration(&rig.cameras).as_bytes())?;
    output.write(truth::FILE, truth::truth(rig).as_bytes())?;
    output.finish()
}

/// The folder to write, and where it is until it is complete.
struct Target<'a> {
    folder: &'a Path,
    temporary: &'a Path,
}

impl Target<'_> {
    /// Writes a file with its temporary path.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names its path and the reason.
    fn write(&self, name: &str, fill: impl FnOnce(&Path) -> io::Result<()>) -> Result<PathBuf, Fault> {
        let path = self.temporary.join(name);
        match fill(&path) {
            Ok(()) => Ok(path),
            Err(error) => {
                let path = self.folder.join(name);
                Err(Fault::Usage(format!("cannot write {}: {error}; name another place", path.display())))
            }
        }
    }
}

/// Writes the video of a camera and, if asked, its masks and its plate.
fn write_camera(
    target: &Target<'_>,
    rig: &Rig,
    camera: usize,
    on_picture: &mut impl FnMut(),
) -> Result<(), Fault> {
    let (settings, errors) = (&rig.settings, &rig.errors[camera]);
    let [width, height] = settings.size;
    let size = if errors.is_rotated { [height, width] } else { [width, height] };
    let format =
        VideoFormat { size, millifps: settings.millifps(), timing: &errors.timing, crf: settings.crf };
    let (id, video) = (name(camera), format!("{}.mp4", name(camera)));
    let sound = target.write(&format!("{id}.wav"), |path| write_sound(rig, camera, path))?;
    let (path, shown) = (target.temporary.join(&video), target.folder.join(&video));
    let mut encoding = Encoding::begin(&path, &shown, &sound, &format)?;
    if settings.masks {
        target.write(&format!("masks/{id}"), |path| fs::create_dir_all(path))?;
    }
    let view = rig.view(camera);
    if settings.masks {
        target.write("plates", |path| fs::create_dir_all(path))?;
        output::write_png(
            &target.temporary.join(format!("plates/{id}.png")),
            &view.plate(),
            (width, height),
        )?;
    }
    let batch = BATCH_PER_THREAD * rayon::current_num_threads();
    for first in (0..errors.frames).step_by(batch) {
        let frames = first..errors.frames.min(first + batch);
        let pictures: Vec<RigPicture> =
            frames.clone().into_par_iter().map(|frame| view.picture(frame)).collect();
        for (frame, RigPicture { colors, mask }) in frames.zip(pictures) {
            let stored = if errors.is_rotated { on_its_side(&colors, settings.size) } else { colors };
            if !encoding.write(&stored)? {
                return Err(encoding.failure());
            }
            if settings.masks {
                let name = format!("masks/{id}/{frame:06}.png");
                target.write(&name, |path| mask_png(path, &rig.cameras[camera], &mask))?;
            }
            on_picture();
        }
    }
    encoding.finish()?;
    if errors.is_rotated {
        target.write(&video, |path| turn_clockwise(path, width))?;
    }
    target.write(&format!("{id}.wav"), |path| fs::remove_file(path)).map(drop)
}

/// Writes the sound of a camera as long as its video.
fn write_sound(rig: &Rig, camera: usize, path: &Path) -> io::Result<()> {
    let errors = &rig.errors[camera];
    let length_s = errors.timing.seconds(errors.frames - 1) + 1.0 / rig.settings.fps;
    let microphone = Microphone {
        sound: &rig.sound,
        errors,
        delay_s: rig.sound.delay_s(rig.cameras[camera].position()),
        noise_db: rig.settings.perturbations.sound_noise_db,
        camera,
    };
    let mut file = BufWriter::new(File::create(path)?);
    microphone.write_wav((length_s * f64::from(RATE)).ceil() as usize, &mut file)?;
    file.flush()
}
