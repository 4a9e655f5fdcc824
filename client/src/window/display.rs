//! The connection to the display, or why there is none.

use std::panic::catch_unwind;

use program::Fault;
use winit::event_loop::EventLoop;

/// The error if the libraries of X are not installed.
const LIBRARY_MISSING: &str = "a library is missing, on Debian and Ubuntu: \
                               apt-get install libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0";

/// Connects to the display.
///
/// # Errors
/// [`Fault::Device`] with the reason.
pub(super) fn connect<E: 'static>() -> Result<EventLoop<E>, Fault> {
    // The window library panics if a library of X is missing.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let opened = catch_unwind(|| EventLoop::with_user_event().build());
    std::panic::set_hook(hook);
    let reason = match opened {
        Ok(Ok(event_loop)) => return Ok(event_loop),
        Ok(Err(error)) if error.to_string().contains("shared libraries") => LIBRARY_MISSING.into(),
        Ok(Err(error)) => no_display(|name| std::env::var(name).ok(), &error.to_string()),
        Err(_) => LIBRARY_MISSING.into(),
    };
    Err(Fault::Device(format!(
        "no display to open a window on: {reason}: give --headless --out PATH for images"
    )))
}

/// Why there is no display, from the environment and from the error of the window library, which may begin
/// with a line of its source.
fn no_display(variable: impl Fn(&str) -> Option<String>, error: &str) -> String {
    let set = |name: &str| {
        let value = variable(name).filter(|value| !value.is_empty())?;
        Some(format!("{name}={value}"))
    };
    // In the order in which the window library tries them.
    let Some(display) = ["WAYLAND_DISPLAY", "DISPLAY"].into_iter().find_map(set) else {
        return "neither WAYLAND_DISPLAY nor DISPLAY is set".into();
    };
    let cause = match error.split_once(".rs:") {
        Some((_, rest)) => rest.trim_start_matches(|c: char| c.is_ascii_digit()).trim_start_matches(": "),
        None => error,
    };
    format!("cannot connect to {display} ({cause})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_absent_display_is_explained() {
        assert_eq!(no_display(|_| None, "?"), "neither WAYLAND_DISPLAY nor DISPLAY is set");
        let empty = |name: &str| Some(if name == "DISPLAY" { ":9" } else { "" }.to_owned());
        let error = "os error at a/b/mod.rs:788: no server: x: absent";
        assert_eq!(no_display(empty, error), "cannot connect to DISPLAY=:9 (no server: x: absent)");
        assert_eq!(
            no_display(|_| Some("x".into()), "refused"),
            "cannot connect to WAYLAND_DISPLAY=x (refused)"
        );
    }
}
