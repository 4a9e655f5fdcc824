//! Asks the runtime for a headset of a kind that does not exist. Tests run this to see that the
//! validation layer between program and runtime is awake.

#![allow(unsafe_code, reason = "a library is loaded")]

use openxr as xr;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // SAFETY: the OpenXR loader of the system is what it says.
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
