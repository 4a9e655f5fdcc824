//! [`Workshop`]: a temporary folder with a clip and a field, in which programs run and must refuse bad input.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use aarc_tests::outcome::{Outcome, contents};
use aarc_tests::programs::{Folder, run};
use aarc_tests::scene::{Motion, Recipe, info, packaged};
use codec::Field;
use formats::write_field_file;
use image::RgbImage;
use serde_json::Value;

/// A temporary folder in which programs run, with a clip and a field in it.
pub(crate) struct Workshop {
    pub(crate) folder: Folder,
    before: BTreeMap<PathBuf, Vec<u8>>,
}

/// The field of the workshop.
pub(crate) const RECIPE: Recipe =
    Recipe { count: 500, sh_degree: 1, motion: Motion::Mixed, motion_order: 3, turning: false, seed: 11 };

impl Workshop {
    pub(crate) fn new() -> Workshop {
        let workshop = Workshop { folder: Folder::default(), before: BTreeMap::new() };
        workshop.write("clip.aarc", &packaged(&RECIPE.field(), None, &[100, 200]));
        workshop.write("field.ply", &write_field_file(&RECIPE.field(), &info()));
        workshop
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) {
        self.folder.write(name, bytes);
    }

    /// Runs a program here with the words of a line as arguments.
    pub(crate) fn run(&self, program: &Path, line: &str) -> Outcome {
        run(&mut self.folder.command(program, line))
    }

    pub(crate) fn json(&self, name: &str) -> Result<Value, String> {
        serde_json::from_slice(&self.folder.read(name)?).map_err(|error| format!("{name}: {error}"))
    }

    pub(crate) fn image(&self, name: &str) -> Result<RgbImage, String> {
        Ok(image::open(self.path(name)).map_err(|error| format!("{name}: {error}"))?.into_rgb8())
    }

    /// Every path in the folder with its file's bytes; empty for folders.
    pub(crate) fn contents(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        contents(&self.path(""))
    }

    /// Records the contents that refused commands must not change. Call it after the last write.
    pub(crate) fn seal(mut self) -> Workshop {
        self.before = self.contents();
        self
    }

    /// Expects a command to fail with this code and one line on stderr that contains `mention`, and to
    /// change no file.
    pub(crate) fn refuses(&self, program: &Path, line: &str, code: i32, mention: &str) -> Result<(), String> {
        let name = program.file_name().expect("a program has a name").to_string_lossy();
        self.refused(&self.run(program, line), code, mention, "")
            .map_err(|why| format!("{name} {line}: {why}"))
    }

    /// Checks that a command failed with this code and one line on stderr that says `what` and then the next
    /// `step`, and changed no file.
    pub(crate) fn refused(&self, outcome: &Outcome, code: i32, what: &str, step: &str) -> Result<(), String> {
        outcome.refuses(code, what, step)?;
        match self.contents() == self.before {
            true => Ok(()),
            false => Err(format!("it changed something: now there are {:?}", self.contents().into_keys())),
        }
    }
}

/// A workshop with damaged, foreign and incomplete files.
pub(crate) fn bad_files() -> Workshop {
    let workshop = Workshop::new();
    let clip = fs::read(workshop.path("clip.aarc")).expect("written before");
    workshop.write("empty", b"");
    workshop.write("noise", b"this is not what you are looking for");
    workshop.write("short.aarc", &clip[..40]);
    let mut flipped = clip.clone();
    flipped[clip.len() / 3] ^= 0x10;
    workshop.write("flipped.aarc", &flipped);
    let mut version = clip.clone();
    version[4] = 99;
    workshop.write("version.aarc", &version);
    workshop.write("longer.aarc", &[&clip[..], b"more"].concat());
    workshop.write("nothing.ply", &write_field_file(&Field::default(), &info()));
    workshop.write(
        "points.ply",
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n",
    );
    let field = fs::read(workshop.path("field.ply")).expect("written before");
    workshop.write("cut.ply", &field[..field.len() / 2]);
    fs::create_dir(workshop.path("bare")).expect("temporary files can be written");
    workshop.write("bare/readme.txt", b"no field here");
    workshop.write("camera.json", b"{\"width\": 64}");
    workshop.write("singular.json", b"{\"width\":64,\"height\":48,\"K\":[[0,0,32],[0,0,24],[0,0,1]],\"world_to_camera\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}");
    workshop.seal()
}
