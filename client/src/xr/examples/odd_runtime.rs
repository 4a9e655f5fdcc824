//! An OpenXR layer that makes a runtime odd. Tests load it between the player and the runtime.
//!
//! `AARC_RUNTIME` says how: `views:N` reports N views of two eyes, `one-eye` refuses two eyes, as runtimes with one or
//! four views do, `no-time` predicts no display time, `no-period` no period and offers no rates, `one-layer` refuses
//! frames with more than one projection layer. The layer implements version 1 of the loader's interface: it hands out
//! its own functions for the names that it changes, and the functions of the next layer or the runtime for all others.

#![allow(unsafe_code, reason = "a layer speaks the loader's C interface")]

use std::ffi::{CStr, c_char};
use std::mem::transmute;
use std::sync::OnceLock;

use openxr::sys::{
    ApiLayerCreateInfo, CURRENT_API_VERSION, CompositionLayerBaseHeader, Duration, FrameEndInfo, FrameState,
    FrameWaitInfo, Instance, InstanceCreateInfo, NegotiateApiLayerRequest, NegotiateLoaderInfo, Result,
    Session, StructureType, SystemId, Time, ViewConfigurationType, ViewConfigurationView, pfn,
};

/// `xrGetInstanceProcAddr` of the next layer or the runtime, and the functions of it that this layer calls.
static NEXT: OnceLock<pfn::GetInstanceProcAddr> = OnceLock::new();
static VIEWS: OnceLock<pfn::EnumerateViewConfigurationViews> = OnceLock::new();
static WAIT: OnceLock<pfn::WaitFrame> = OnceLock::new();
static END: OnceLock<pfn::EndFrame> = OnceLock::new();

/// How the runtime is odd.
fn oddity() -> &'static str {
    static ODDITY: OnceLock<String> = OnceLock::new();
    ODDITY.get_or_init(|| std::env::var("AARC_RUNTIME").unwrap_or_default())
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
            b"xrWaitFrame" => {
                WAIT.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::WaitFrame, pfn::VoidFunction>(wait));
            }
            b"xrEndFrame" => {
                END.get_or_init(|| transmute(theirs));
                *found = Some(transmute::<pfn::EndFrame, pfn::VoidFunction>(end));
            }
            b"xrEnumerateDisplayRefreshRatesFB" if oddity() == "no-period" => {
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
    if oddity() == "one-eye" {
        return Result::ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED;
    }
    let Some(reported) = oddity().strip_prefix("views:").and_then(|count| count.parse().ok()) else {
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
        match oddity() {
            "no-time" => (*state).predicted_display_time = Time::from_nanos(0),
            "no-period" => (*state).predicted_display_period = Duration::from_nanos(0),
            _ => {}
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
        if oddity() == "one-layer" && (0..layer_count as usize).filter(|&i| is_projection(i)).count() > 1 {
            return Result::ERROR_LAYER_LIMIT_EXCEEDED;
        }
        next(session, info)
    }
}
