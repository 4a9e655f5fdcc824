//! Asks the runtime for a kind of headset that does not exist. Tests run this to check that the validation layer
//! between program and runtime is active.

#![allow(unsafe_code, reason = "a library is loaded")]

use openxr as xr;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // SAFETY: the library with this name is the system's OpenXR loader.
    let entry = unsafe { xr::Entry::load(&()) }?;
    let application = xr::ApplicationInfo {
        application_name: "forbidden call",
        application_version: 1,
        engine_name: "",
        engine_version: 0,
        api_version: xr::Version::new(1, 0, 0),
    };
    let instance = entry.create_instance(&application, &xr::ExtensionSet::default(), &[], &())?;
    match instance.system(xr::FormFactor::from_raw(9999)) {
        Ok(_) => Err("a headset of no kind was found".into()),
        Err(_) => Ok(()),
    }
}
