//! `XR_KHR_android_thread_settings`: the roles of threads, by which the headset chooses cores and priorities.

#![cfg_attr(target_os = "android", allow(unsafe_code, reason = "the function has no safe form"))]

use std::path::Path;

#[cfg(target_os = "android")]
use openxr as xr;

/// Names the calling thread as the thread that draws and submits frames, and the activity's as the main thread.
#[cfg(target_os = "android")]
pub(in crate::xr) fn assign(session: &xr::Session<xr::Vulkan>) {
    let Some(settings) = &session.instance().exts().khr_android_thread_settings else { return };
    // The first thread of a process on Android is the activity's, and has the number of the process.
    let main = Some(std::process::id());
    let here = std::fs::read_link("/proc/thread-self").ok().and_then(|link| thread_id(&link));
    for (role, thread) in
        [(xr::AndroidThreadTypeKHR::APPLICATION_MAIN, main), (xr::AndroidThreadTypeKHR::RENDERER_MAIN, here)]
    {
        let Some(thread) = thread else { continue };
        // SAFETY: the function was loaded for this instance, and the session lives.
        let code = unsafe { (settings.set_android_application_thread)(session.as_raw(), role, thread) };
        if code != xr::sys::Result::SUCCESS {
            log::info!("thread {thread} as {role:?}: {code:?}");
        }
    }
}

/// The kernel's number of a thread, from where `/proc/thread-self` leads: `PROCESS/task/THREAD`.
fn thread_id(link: &Path) -> Option<u32> {
    link.file_name()?.to_str()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_have_the_numbers_of_the_kernel() {
        assert_eq!(thread_id(Path::new("12/task/345")), Some(345));
        assert_eq!(thread_id(Path::new("12/task/self")), None);
        assert_eq!(thread_id(Path::new("/")), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn each_thread_has_its_own() {
        let id = || thread_id(&std::fs::read_link("/proc/thread-self").unwrap());
        let here = id();
        assert!(here.is_some());
        assert_ne!(std::thread::spawn(id).join().unwrap(), here);
    }
}
