//! Writes the inputs that fuzzing starts from into folders named as the targets, in the folder named
//! on the command line.

use std::{env, fs, path::PathBuf};

use aarc_fuzz::seeds;
// What is instrumented calls it.
use libfuzzer_sys as _;

fn main() {
    let folder = PathBuf::from(env::args_os().nth(1).expect("usage: tool-seeds FOLDER"));
    for (target, seeds) in [
        ("import", seeds::fields()),
        ("scene", seeds::scenes()),
        ("capture", seeds::captures()),
        ("net", seeds::dialogues()),
    ] {
        let folder = folder.join(target);
        fs::create_dir_all(&folder).expect("the folder can be made");
        for (name, bytes) in seeds {
            fs::write(folder.join(name), bytes).expect("the folder can be written to");
        }
    }
}
