//! An OpenXR layer that makes a runtime odd. Tests load it between the player and the runtime.
//!
//! `AARC_RUNTIME` lists the oddities, with blanks between: `views:N` reports N views of two eyes, `one-eye` refuses two
//! eyes, as runtimes with one or four views do, `no-time` predicts no display time, `no-period` no period and offers no
//! rates, `one-layer` refuses frames with more than one projection layer. `room` offers to blend the room, does not
//! know where the head is once the room is shown, and prints the blend mode of the next frame without layers. The
//! others count frames: `stage-moves:N` moves the stage by [`MOVE_M`] with frame N, `head-lost:N` does not know where
//! the head is in [`LOST_FRAMES`] frames from N on, `session-lost:N` announces the loss of the session after each N
//! frames, and `runtime-lost:N` that of the runtime after N.
//!
//! The layer implements version 1 of the loader's interface: it hands out its own functions for the names that it
//! changes, and the functions of the next layer or the runtime for all others.

#![allow(unsafe_code, reason = "a layer speaks the loader's C interface")]

use std::ffi::{CStr, c_char};
use std::mem::transmute;
use std::ptr::null;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock};

use openxr::sys::{
    ApiLayerCreateInfo, CURRENT_API_VERSION, CompositionLayerBaseHeader, Duration, EnvironmentBlendMode,
    EventDataBuffer, EventDataInstanceLossPending, EventDataReferenceSpaceChangePending,
    EventDataSessionStateChanged, FrameEndInfo, FrameState, FrameWaitInfo, Instance, InstanceCreateInfo,
    NegotiateApiLayerRequest, NegotiateLoaderInfo, Posef, ReferenceSpaceType, Result, Session, SessionState,
    StructureType, SystemId, TRUE, Time, Vector3f, View, ViewConfigurationType, ViewConfigurationView,
    ViewLocateInfo, ViewState, ViewStateFlags, pfn,
};

/// Metres by which `stage-moves` moves the stage to the right.
const MOVE_M: f32 = 1.0;

/// `xrGetInstanceProcAddr` of the next layer or the runtime, and the functions of it that this layer calls.
static NEXT: OnceLock<pfn::GetInstanceProcAddr> = OnceLock::new();
static VIEWS: OnceLock<pfn::EnumerateViewConfigurationViews> = OnceLock::new();
static BLENDS: OnceLock<pfn::EnumerateEnvironmentBlendModes> = OnceLock::new();
static POLL: OnceLock<pfn::PollEvent> = OnceLock::new();
static WAIT: OnceLock<pfn::WaitFrame> = OnceLock::new();
static LOCATE: OnceLock<pfn::LocateViews> = OnceLock::new();
static END: OnceLock<pfn::EndFrame> = OnceLock::new();

/// Frames in which `head-lost` does not know where the head is.
const LOST_FRAMES: u64 = 20;

/// Number of frames that have ended, of all sessions.
static FRAMES: AtomicU64 = AtomicU64::new(0);

/// Whether a frame has shown the room.
static SHOWS_ROOM: AtomicBool = AtomicBool::new(false);

/// Events that [`poll`] hands out before those of the runtime.
static EVENTS: Mutex<Vec<Event>> = Mutex::new(Vec::new());

/// An event of this layer; times are in nanoseconds.
enum Event {
    StageMoves(Session, i64),
    SessionLost(Session, i64),
    RuntimeLost(i64),
}

/// The number of the oddity `name`, 0 without one; `None` if the runtime has not this oddity.
fn oddity(name: &str) -> Option<u64> {
    static ODDITIES: OnceLock<String> = OnceLock::new();
    let oddities = ODDITIES.get_or_init(|| std::env::var("AARC_RUNTIME").unwrap_or_default());
    oddities.split(' ').find_map(|oddity| {
        let (found, number) = oddity.split_once(':').unwrap_or((oddity, "0"));
        (found == name).then(|| number.parse().expect("an oddity has a number"))
    })
}

fn has(name: &str) -> bool {
    oddity(name).is_some()
}

/// Entry point of the layer.
///
/// # Safety
/// `request` is a valid pointer.
// SAFETY: no other library of the process has this name.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn xrNegotiateLoaderApiLayerInterface(
    _: *const NegotiateLoaderInfo,
    _: *const c_char,
    request: *mut NegotiateApiLayerRequest,
) -> Result {
    // SAFETY: the loader passes a valid pointer.
    let request = unsafe { &mut *request };
    request.layer_interface_version = 1;
    request.layer_api_version = CURRENT_API_VERSION;
    request.get_instance_proc_addr = Some(function);
    request.create_api_layer_instance = Some(create_instance);
    Result::SUCCESS
}

// SAFETY: called by the loader, with structures that it made.
unsafe extern "system" fn create_instance(
    info: *const InstanceCreateInfo,
    layer: *const ApiLayerCreateInfo,
    instance: *mut Instance,
) -> Result {
    // SAFETY: the loader passes a link for each layer; the first is this one's.
    let (next, mut rest) = unsafe { (*(*layer).next_info, *layer) };
    rest.next_info = next.next;
    let (Some(next_function), Some(create)) =
        (next.next_get_instance_proc_addr, next.next_create_api_layer_instance)
    else {
        return Result::ERROR_INITIALIZATION_FAILED;
    };
    NEXT.get_or_init(|| next_function);
    // SAFETY: the arguments are the loader's.
    unsafe { create(info, &rest, instance) }
}

// SAFETY: as `xrGetInstanceProcAddr`.
unsafe extern "system" fn function(
    instance: Instance,
    name: *const c_char,
    function: *mut Option<pfn::VoidFunction>,
) -> Result {
    let Some(next) = NEXT.get() else { return Result::ERROR_HANDLE_INVALID };
    // SAFETY: the arguments are the caller's, and `name` a string.
    let (result, name) = unsafe { (next(instance, name, function), CStr::from_ptr(name)) };
    if result != Result::SUCCESS {
        return result;
    }
    // SAFETY: the runtime succeeded and wrote the function of this name, which has the type of this name; so have those
    // that replace it.
    unsafe {
        let found = &mut *function;
        let Some(theirs) = *found else { return result };
        match name.to_bytes() {
            b"xrEnumerateViewConfigurationViews" => {
                VIEWS.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::EnumerateViewConfigurationViews, pfn::VoidFunction>(views));
            }
            b"xrEnumerateEnvironmentBlendModes" if has("room") => {
                BLENDS.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::EnumerateEnvironmentBlendModes, pfn::VoidFunction>(blends));
            }
            b"xrPollEvent" => {
                POLL.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::PollEvent, pfn::VoidFunction>(poll));
            }
            b"xrLocateViews" => {
                LOCATE.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::LocateViews, pfn::VoidFunction>(locate));
            }
            b"xrWaitFrame" => {
                WAIT.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::WaitFrame, pfn::VoidFunction>(wait));
            }
            b"xrEndFrame" => {
                END.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::EndFrame, pfn::VoidFunction>(end));
            }
            b"xrEnumerateDisplayRefreshRatesFB" if has("no-period") => {
                *found = Some(transmute::<pfn::EnumerateDisplayRefreshRatesFB, pfn::VoidFunction>(no_rates));
            }
            _ => {}
        }
    }
    result
}

// SAFETY: as `xrEnumerateDisplayRefreshRatesFB`.
unsafe extern "system" fn no_rates(_: Session, _: u32, count: *mut u32, _: *mut f32) -> Result {
    // SAFETY: the caller has room for a count.
    unsafe { *count = 0 };
    Result::SUCCESS
}

// SAFETY: as `xrEnumerateViewConfigurationViews`.
unsafe extern "system" fn views(
    instance: Instance,
    system: SystemId,
    configuration: ViewConfigurationType,
    capacity: u32,
    count: *mut u32,
    views: *mut ViewConfigurationView,
) -> Result {
    let Some(next) = VIEWS.get() else { return Result::ERROR_FUNCTION_UNSUPPORTED };
    if has("one-eye") {
        return Result::ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED;
    }
    let Some(reported) = oddity("views").map(|count| count as u32) else {
        // SAFETY: the arguments are the caller's.
        return unsafe { next(instance, system, configuration, capacity, count, views) };
    };
    // SAFETY: the caller has room for a count, and for `capacity` views, which it has initialised.
    unsafe {
        *count = reported;
        for i in 0..capacity.min(reported) as usize {
            let view = &mut *views.add(i);
            (view.recommended_image_rect_width, view.recommended_image_rect_height) = (320, 240);
        }
    }
    Result::SUCCESS
}

// SAFETY: as `xrEnumerateEnvironmentBlendModes`.
unsafe extern "system" fn blends(
    instance: Instance,
    system: SystemId,
    configuration: ViewConfigurationType,
    capacity: u32,
    count: *mut u32,
    modes: *mut EnvironmentBlendMode,
) -> Result {
    let Some(next) = BLENDS.get() else { return Result::ERROR_FUNCTION_UNSUPPORTED };
    // SAFETY: the caller has room for a count, and for `capacity` modes; the runtime is asked for no more.
    unsafe {
        let result = next(instance, system, configuration, capacity.saturating_sub(1), count, modes);
        if result == Result::SUCCESS {
            if capacity > 0 {
                *modes.add(*count as usize) = EnvironmentBlendMode::ALPHA_BLEND;
            }
            *count += 1;
        }
        result
    }
}

// SAFETY: as `xrPollEvent`.
unsafe extern "system" fn poll(instance: Instance, event: *mut EventDataBuffer) -> Result {
    let Some(next) = POLL.get() else { return Result::ERROR_FUNCTION_UNSUPPORTED };
    let ours = EVENTS.lock().ok().and_then(|mut events| events.pop());
    // SAFETY: the arguments are the caller's; a buffer has room for each event and their alignment.
    unsafe {
        match ours {
            None => return next(instance, event),
            Some(Event::StageMoves(session, ns)) => {
                let position = Vector3f { x: MOVE_M, ..Vector3f::default() };
                event.cast::<EventDataReferenceSpaceChangePending>().write(
                    EventDataReferenceSpaceChangePending {
                        ty: EventDataReferenceSpaceChangePending::TYPE,
                        next: null(),
                        session,
                        reference_space_type: ReferenceSpaceType::STAGE,
                        change_time: Time::from_nanos(ns),
                        pose_valid: TRUE,
                        pose_in_previous_space: Posef { position, ..Posef::IDENTITY },
                    },
                );
            }
            Some(Event::SessionLost(session, ns)) => {
                event.cast::<EventDataSessionStateChanged>().write(EventDataSessionStateChanged {
                    ty: EventDataSessionStateChanged::TYPE,
                    next: null(),
                    session,
                    state: SessionState::LOSS_PENDING,
                    time: Time::from_nanos(ns),
                });
            }
            Some(Event::RuntimeLost(ns)) => {
                event.cast::<EventDataInstanceLossPending>().write(EventDataInstanceLossPending {
                    ty: EventDataInstanceLossPending::TYPE,
                    next: null(),
                    loss_time: Time::from_nanos(ns),
                });
            }
        }
    }
    Result::SUCCESS
}

// SAFETY: as `xrLocateViews`.
unsafe extern "system" fn locate(
    session: Session,
    info: *const ViewLocateInfo,
    state: *mut ViewState,
    capacity: u32,
    count: *mut u32,
    views: *mut View,
) -> Result {
    let Some(next) = LOCATE.get() else { return Result::ERROR_FUNCTION_UNSUPPORTED };
    let frame = FRAMES.load(Ordering::Relaxed);
    let is_lost = oddity("head-lost").is_some_and(|from| (from..from + LOST_FRAMES).contains(&frame));
    // SAFETY: the arguments are the caller's, and the runtime has written the state.
    unsafe {
        let result = next(session, info, state, capacity, count, views);
        if is_lost || SHOWS_ROOM.load(Ordering::Relaxed) {
            (*state).view_state_flags = ViewStateFlags::EMPTY;
        }
        result
    }
}

// SAFETY: as `xrWaitFrame`.
unsafe extern "system" fn wait(
    session: Session,
    info: *const FrameWaitInfo,
    state: *mut FrameState,
) -> Result {
    let Some(next) = WAIT.get() else { return Result::ERROR_FUNCTION_UNSUPPORTED };
    // SAFETY: the arguments are the caller's, and the runtime has written the state.
    unsafe {
        let result = next(session, info, state);
        if has("no-time") {
            (*state).predicted_display_time = Time::from_nanos(0);
        }
        if has("no-period") {
            (*state).predicted_display_period = Duration::from_nanos(0);
        }
        result
    }
}

// SAFETY: as `xrEndFrame`.
unsafe extern "system" fn end(session: Session, info: *const FrameEndInfo) -> Result {
    let Some(next) = END.get() else { return Result::ERROR_FUNCTION_UNSUPPORTED };
    // SAFETY: the caller passes pointers to as many layers as it says.
    unsafe {
        let FrameEndInfo { layer_count, layers, .. } = *info;
        let is_projection = |i: usize| {
            let layer: *const CompositionLayerBaseHeader = *layers.add(i);
            (*layer).ty == StructureType::COMPOSITION_LAYER_PROJECTION
        };
        if has("one-layer") && (0..layer_count as usize).filter(|&i| is_projection(i)).count() > 1 {
            return Result::ERROR_LAYER_LIMIT_EXCEEDED;
        }
        announce(session, (*info).display_time.as_nanos());
        if !has("room") {
            return next(session, info);
        }
        let mode = (*info).environment_blend_mode;
        if mode == EnvironmentBlendMode::ALPHA_BLEND && layer_count > 0 {
            SHOWS_ROOM.store(true, Ordering::Relaxed);
        } else if layer_count == 0 && SHOWS_ROOM.swap(false, Ordering::Relaxed) {
            eprintln!("no layers over {mode:?}");
        }
        next(session, &FrameEndInfo { environment_blend_mode: EnvironmentBlendMode::OPAQUE, ..*info })
    }
}

/// Counts a frame that is shown at `ns` nanoseconds, and announces what comes after it.
fn announce(session: Session, ns: i64) {
    let frame = FRAMES.fetch_add(1, Ordering::Relaxed) + 1;
    let Ok(mut events) = EVENTS.lock() else { return };
    if oddity("stage-moves") == Some(frame) {
        events.push(Event::StageMoves(session, ns));
    }
    if oddity("session-lost").is_some_and(|every| frame.is_multiple_of(every)) {
        events.push(Event::SessionLost(session, ns));
    }
    if oddity("runtime-lost") == Some(frame) {
        events.push(Event::RuntimeLost(ns));
    }
}
