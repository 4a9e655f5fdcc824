//! `cargo xtask apk` and the password of the signing key: no build sees it, the packer does.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use aarc_tests::programs::{Folder, run};
use libtest_mimic::{Failed, Trial};
use xtask::workspace;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let trial = Trial::test("only the packer knows the password", || {
        only_the_packer_knows_the_password().map_err(Failed::from)
    });
    vec![trial]
}

const PASSWORD: &str = "correct-horse";

/// Runs the real Cargo, and logs its environment; a script stands in for the packer that it would build.
const CARGO: &str = r#"#!/bin/sh
env >> "$LOGS/builds"
case "$*" in build*) ;; *) exec "$REAL_CARGO" "$@";; esac
echo "{\"target\":{\"name\":\"apk-packer\",\"kind\":[\"bin\"]},\"executable\":\"$LOGS/packer\"}"
"#;

const PACKER: &str = "#!/bin/sh\nenv > \"$LOGS/packing\"\n";

fn only_the_packer_knows_the_password() -> Result<(), String> {
    let xtask = workspace::build("xtask", "dev").map_err(|fault| fault.to_string())?;
    let folder = Folder::default();
    for name in ["libclient.so", "libopenxr_loader.so"] {
        folder.write(name, b"\x7fELF, as far as the loader is looked at");
    }
    for (name, script) in [("cargo", CARGO), ("packer", PACKER)] {
        folder.write(name, script.as_bytes());
        make_executable(&folder.path(name))?;
    }
    let line = "apk --library libclient.so --openxr-loader libopenxr_loader.so -o a.apk";
    let real = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = folder.command(&xtask, line);
    command.env("CARGO", folder.path("cargo")).env("REAL_CARGO", real).env("LOGS", folder.path(""));
    run(command.env("APK_KEYSTORE", "release.p12").env("APK_KEYSTORE_PASSWORD", PASSWORD)).success();
    let knows = |log: &str| Ok::<_, String>(String::from_utf8_lossy(&folder.read(log)?).contains(PASSWORD));
    match (knows("builds")?, knows("packing")?) {
        (false, true) => Ok(()),
        (builds, packer) => Err(format!("builds know the password: {builds}; the packer: {packer}")),
    }
}

fn make_executable(path: &Path) -> Result<(), String> {
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).map_err(|error| error.to_string())
}
