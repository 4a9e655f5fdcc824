//! Measures what playing a clip costs and keeps, for `cargo xtask report`.
//!
//! `playing CLIP WHOLE WIDTHxHEIGHT` plays the package CLIP and holds it against WHOLE, the package
//! or field that it stands for. Prints JSON, a [`Message`] a line, as soon as it is known.

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use aarc_tests::ending;
use aarc_tests::gpu::{Passes, device};
use aarc_tests::playing::measure;
use anyhow::Context;
use codec::Limits;
use glam::UVec2;
use program::Fault;
use studio::input::read_package;
use studio::report::Subject;
use studio::report::playing::Message;

fn main() -> ExitCode {
    ending::code(run())
}

fn run() -> anyhow::Result<()> {
    let usage = || Fault::Usage("playing CLIP WHOLE WIDTHxHEIGHT".into());
    let args: Vec<OsString> = std::env::args_os().skip(1).collect();
    let [clip, whole, size] = args.as_slice() else { return Err(usage().into()) };
    let (width, height) = size.to_str().and_then(|size| size.split_once('x')).ok_or_else(usage)?;
    let size = UVec2::new(width.parse()?, height.parse()?);
    let path = Path::new(clip);
    let clip = codec::decode(&read_package(path)?, &Limits::default())
        .with_context(|| path.display().to_string())?;
    let whole = Subject::load(Path::new(whole))?;
    let gpu = device(Passes::Shared)?;
    let mut out = io::stdout().lock();
    let mut tell = |message: Message| -> anyhow::Result<()> {
        writeln!(out, "{}", serde_json::to_string(&message)?)?;
        Ok(out.flush()?)
    };
    measure(gpu, &clip, &whole.to_reference(), size, &mut tell)
}
