//! Writes the initial corpus to folders named like the targets, in the folder given on the command line.

use std::{env, fs, path::PathBuf};

use aarc_fuzz::seeds;
// The instrumentation calls it.
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
