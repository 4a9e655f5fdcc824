//! [`Adb`]: Android's program for connected devices, and the headset that it talks to.

use std::env;
use std::ffi::OsStr;
use std::process::{Command, Stdio};

use program::{Fault, counted};

/// The program, as PATH has it.
const PROGRAM: &str = "adb";

/// The program, for one headset.
pub(super) struct Adb {
    serial: String,
}

impl Adb {
    /// Finds the headset: the only device, or the device that `ANDROID_SERIAL` names.
    ///
    /// # Errors
    /// [`Fault::Device`] if the program cannot be run, or there is not exactly one device that allows debugging.
    pub(super) fn find() -> Result<Adb, Fault> {
        let chosen = env::var("ANDROID_SERIAL").ok().filter(|serial| !serial.is_empty());
        let serial = choose(&list()?, chosen.as_deref())?;
        Ok(Adb { serial })
    }

    /// Runs a command for the headset and returns what it prints.
    ///
    /// # Errors
    /// [`Fault::Device`] with the last line of the error, or that the headset is gone.
    pub(super) fn run(&self, args: &[&OsStr]) -> Result<String, Fault> {
        let mut command = Command::new(PROGRAM);
        command.args(["-s", &self.serial]).args(args);
        output(&mut command).map_err(|line| match self.is_attached() {
            true => {
                let command = args.first().copied().unwrap_or_default().display().to_string();
                Fault::Device(format!("adb {command} failed on {}: {line}", self.serial))
            }
            false => Fault::Device(format!(
                "the headset {} is gone: connect it again, keep it awake, and start over",
                self.serial
            )),
        })
    }

    /// Runs a line of the headset's shell and returns what it prints.
    ///
    /// # Errors
    /// As [`Adb::run`].
    pub(super) fn shell(&self, line: &str) -> Result<String, Fault> {
        self.run(&["shell".as_ref(), line.as_ref()])
    }

    fn is_attached(&self) -> bool {
        list().is_ok_and(|devices| choose(&devices, Some(&self.serial)).is_ok())
    }
}

/// The devices that `adb` lists: serial number and state.
fn list() -> Result<Vec<(String, String)>, Fault> {
    let text = output(Command::new(PROGRAM).arg("devices")).map_err(|line| {
        Fault::Device(format!(
            "{PROGRAM} devices: {line}: install Android's platform tools, and put {PROGRAM} on PATH"
        ))
    })?;
    let device =
        |line: &str| line.split_once('\t').map(|(serial, state)| (serial.into(), state.trim().into()));
    Ok(text.lines().filter_map(device).collect())
}

/// The serial number of the device to use among those that are attached.
fn choose(devices: &[(String, String)], chosen: Option<&str>) -> Result<String, Fault> {
    let mut candidates = devices.iter().filter(|(serial, _)| chosen.is_none_or(|chosen| serial == chosen));
    let problem = match (candidates.next(), candidates.next()) {
        (Some((serial, state)), None) => match state.as_str() {
            "device" => return Ok(serial.clone()),
            "unauthorized" => {
                format!("the headset {serial} does not allow debugging: put it on and allow it")
            }
            state => format!("the headset {serial} is not ready ({state}): connect it again, or restart it"),
        },
        (None, _) => match chosen {
            Some(chosen) => format!("no headset {chosen} is attached: connect it, or unset ANDROID_SERIAL"),
            None => "no headset is attached: connect one by USB, in developer mode".into(),
        },
        (Some(_), Some(_)) => {
            let count = counted(devices.len(), "device");
            format!(
                "{count} are attached: disconnect all but one, or set ANDROID_SERIAL to one of `adb devices`"
            )
        }
    };
    Err(Fault::Device(problem))
}

/// Runs a command and returns its standard output, or the line that says why it failed.
pub(super) fn output(command: &mut Command) -> Result<String, String> {
    let output = command.stdin(Stdio::null()).output().map_err(|error| error.to_string())?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if output.status.success() {
        return Ok(text(&output.stdout));
    }
    // `adb shell` passes errors of the device's programs on in either stream.
    let (errors, prints) = (text(&output.stderr), text(&output.stdout));
    let mut lines = errors.lines().rev().chain(prints.lines().rev()).map(str::trim);
    Err(lines.find(|line| !line.is_empty()).map_or_else(|| output.status.to_string(), String::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn devices(text: &str) -> Vec<(String, String)> {
        text.split(' ')
            .filter_map(|device| device.split_once('='))
            .map(|(a, b)| (a.into(), b.into()))
            .collect()
    }

    #[test]
    fn exactly_one_ready_device_is_chosen() {
        assert_eq!(choose(&devices("a=device"), None).unwrap(), "a");
        assert_eq!(choose(&devices("a=device b=device"), Some("b")).unwrap(), "b");
        for (list, chosen, problem) in [
            ("", None, "no headset is attached"),
            ("a=unauthorized", None, "does not allow debugging"),
            ("a=offline", None, "not ready (offline)"),
            ("a=device b=device", None, "2 devices are attached"),
            ("a=device", Some("b"), "no headset b is attached"),
        ] {
            let message = choose(&devices(list), chosen).unwrap_err().to_string();
            assert!(message.contains(problem), "{list}: {message}");
        }
    }
}
