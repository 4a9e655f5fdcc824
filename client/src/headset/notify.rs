//! [`notify`]: a line where the user of the system looks.

/// Prints a line on the terminal of a desktop, or in Android's log.
pub(crate) fn notify(line: &str) {
    #[cfg(target_os = "android")]
    log::warn!("{line}");
    #[cfg(not(target_os = "android"))]
    eprintln!("{line}");
}
