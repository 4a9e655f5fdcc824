//! [`load`]: the system's sound library, loaded when sound is first wanted.
//!
//! cpal links libasound, and a program that needs a library does not start without it: on a server, in a container.
//! Here are the functions that cpal calls, by their own names. Each jumps to an address that [`load`] fills in.
//! LLVM's linker, which Rust takes on x86-64, finds them in the program, which then does not need the library. Other
//! linkers may name it as needed all the same. A test looks at what the program needs.

#![allow(unsafe_code, reason = "a library is loaded, and its functions are called by their addresses")]

use std::arch::global_asm;
use std::ffi::c_void;
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicPtr, Ordering};

use libloading::Library;

/// File name of the library's binary interface, the same on every distribution.
const LIBRARY: &str = "libasound.so.2";

/// Defines functions that jump to their addresses.
macro_rules! functions {
    ($($name:ident)*) => {
        #[allow(non_upper_case_globals, reason = "names of functions")]
        mod addresses {
            use super::{AtomicPtr, c_void, ptr};

            $(pub(super) static $name: AtomicPtr<c_void> = AtomicPtr::new(ptr::null_mut());)*
        }

        /// Names and addresses of the functions. An address is null until the library is loaded.
        static FUNCTIONS: &[(&str, &AtomicPtr<c_void>)] = &[$((stringify!($name), &addresses::$name)),*];

        $(
            global_asm!(
                concat!(".hidden ", stringify!($name)),
                concat!(".globl ", stringify!($name)),
                concat!(stringify!($name), ":"),
                #[cfg(target_arch = "x86_64")]
                "jmp qword ptr [rip + {address}]",
                #[cfg(target_arch = "aarch64")]
                "adrp x16, {address}",
                #[cfg(target_arch = "aarch64")]
                "ldr x16, [x16, :lo12:{address}]",
                #[cfg(target_arch = "aarch64")]
                "br x16",
                address = sym addresses::$name,
            );
        )*
    };
}

functions! {
    snd_config_update
    snd_config_update_free_global
    snd_pcm_avail_delay
    snd_pcm_bytes_to_frames
    snd_pcm_close
    snd_pcm_format_physical_width
    snd_pcm_get_params
    snd_pcm_hw_params
    snd_pcm_hw_params_any
    snd_pcm_hw_params_can_resume
    snd_pcm_hw_params_copy
    snd_pcm_hw_params_current
    snd_pcm_hw_params_free
    snd_pcm_hw_params_get_buffer_size_max
    snd_pcm_hw_params_get_channels_max
    snd_pcm_hw_params_get_channels_min
    snd_pcm_hw_params_get_period_size
    snd_pcm_hw_params_get_period_size_max
    snd_pcm_hw_params_get_period_size_min
    snd_pcm_hw_params_get_rate_max
    snd_pcm_hw_params_get_rate_min
    snd_pcm_hw_params_malloc
    snd_pcm_hw_params_set_access
    snd_pcm_hw_params_set_buffer_size_near
    snd_pcm_hw_params_set_channels
    snd_pcm_hw_params_set_format
    snd_pcm_hw_params_set_period_size_near
    snd_pcm_hw_params_set_rate
    snd_pcm_hw_params_supports_audio_ts_type
    snd_pcm_hw_params_test_channels
    snd_pcm_hw_params_test_format
    snd_pcm_hw_params_test_rate
    snd_pcm_info
    snd_pcm_info_free
    snd_pcm_info_get_stream
    snd_pcm_info_malloc
    snd_pcm_open
    snd_pcm_pause
    snd_pcm_poll_descriptors
    snd_pcm_poll_descriptors_count
    snd_pcm_poll_descriptors_revents
    snd_pcm_prepare
    snd_pcm_resume
    snd_pcm_start
    snd_pcm_state
    snd_pcm_status
    snd_pcm_status_get_audio_htstamp
    snd_pcm_status_get_htstamp
    snd_pcm_status_get_state
    snd_pcm_status_get_trigger_htstamp
    snd_pcm_status_set_audio_htstamp_config
    snd_pcm_status_sizeof
    snd_pcm_sw_params
    snd_pcm_sw_params_current
    snd_pcm_sw_params_free
    snd_pcm_sw_params_malloc
    snd_pcm_sw_params_set_avail_min
    snd_pcm_sw_params_set_start_threshold
    snd_pcm_sw_params_set_tstamp_mode
    snd_pcm_sw_params_set_tstamp_type
    snd_pcm_writei
}

/// Loads the library, once. No function of cpal may be called before it succeeds.
///
/// # Errors
/// Why there is none.
pub(super) fn load() -> Result<(), String> {
    static LOADED: OnceLock<Result<Library, String>> = OnceLock::new();
    LOADED.get_or_init(|| open(LIBRARY)).as_ref().map(|_| ()).map_err(Clone::clone)
}

/// Loads the library `name` and fills in the addresses.
///
/// # Errors
/// That it cannot be loaded, or lacks a function.
fn open(name: &str) -> Result<Library, String> {
    // SAFETY: loading the system's sound library runs its own start-up code alone.
    let library = unsafe { Library::new(name) }.map_err(|error| format!("no sound library: {error}"))?;
    let address = |function: &str| {
        // SAFETY: the address is called with the types that the library's header states, through alsa-sys.
        let symbol = unsafe { library.get::<*mut c_void>(function.as_bytes()) };
        symbol.map(|address| *address).map_err(|error| format!("the sound library is too old: {error}"))
    };
    let found = FUNCTIONS.iter().map(|(function, _)| address(function)).collect::<Result<Vec<_>, _>>()?;
    for ((_, address), found) in FUNCTIONS.iter().zip(found) {
        address.store(found, Ordering::Release);
    }
    Ok(library)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_that_is_missing_or_lacks_functions_is_a_sentence() {
        let missing = open("libasound.so.0").err().unwrap();
        assert!(missing.starts_with("no sound library: libasound.so.0: "), "{missing}");
        let other = open("libc.so.6").err().unwrap();
        assert!(
            other.starts_with("the sound library is too old: ") && other.contains("snd_config_update"),
            "{other}"
        );
    }
}
