//! Writes the initial corpus to the folders `decode`, `roundtrip` and `sound` in the folder given on the command line.

use std::{env, fs, path::PathBuf};

fn main() {
    let folder = PathBuf::from(env::args_os().nth(1).expect("usage: seeds FOLDER"));
    for (target, seeds) in [
        ("decode", codec_fuzz::seeds::packages()),
        ("roundtrip", codec_fuzz::seeds::sources()),
        ("sound", codec_fuzz::sound::SoundlessPackage::seeds()),
    ] {
        let folder = folder.join(target);
        fs::create_dir_all(&folder).expect("the folder can be made");
        for (name, bytes) in seeds {
            fs::write(folder.join(name), bytes).expect("the folder can be written to");
        }
    }
}
