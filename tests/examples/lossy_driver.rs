//! A Vulkan layer that simulates the loss of a device and exhausted memory. Tests load it below the player.
//!
//! `AARC_LOSE=submit:N` loses the device in the Nth `vkQueueSubmit`, `AARC_LOSE=wait:N` in the wait after it.
//! From then on `vkQueueSubmit`, `vkCreateBuffer`, `vkAllocateMemory`, `vkWaitForFences`, `vkWaitSemaphores` and
//! `vkGetSemaphoreCounterValue` return `VK_ERROR_DEVICE_LOST`; other calls are passed on. A suffix `:M` loses
//! only the first M devices. `AARC_LOSE=upload:N` loses the device in the first `vkCreateBuffer` of N bytes or
//! more. `AARC_LOSE=memory:N` fails `vkAllocateMemory` from the Nth call on. The layer implements version 2 of the interface in "LoaderLayerInterface.md" of the Vulkan loader.

#![allow(unsafe_code, reason = "a layer speaks the loader's C interface")]

use std::ffi::{CStr, c_char, c_void};
use std::mem::transmute;
use std::ptr::{null, null_mut};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use ash::vk;

/// Create info by which the loader passes a layer the next link; the same for instances and devices.
#[repr(C)]
struct Chain {
    s_type: i32,
    next: *mut c_void,
    /// 0 if `link` is valid.
    function: i32,
    link: *mut Link,
}

/// The next layer or the driver.
#[repr(C)]
struct Link {
    next: *mut Link,
    instance: vk::PFN_vkGetInstanceProcAddr,
    /// Entry point for physical devices, in the chain of an instance.
    device: Option<vk::PFN_vkGetDeviceProcAddr>,
}

/// `VkNegotiateLayerInterface`.
#[repr(C)]
pub struct Negotiation {
    s_type: i32,
    next: *mut c_void,
    version: u32,
    instance: Option<vk::PFN_vkGetInstanceProcAddr>,
    device: Option<vk::PFN_vkGetDeviceProcAddr>,
    physical_device: *const c_void,
}

/// A function of any type.
// SAFETY: callers transmute it to the type of its name.
type Any = unsafe extern "system" fn();

/// `VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO` and the same for devices.
const INSTANCE_CHAIN: i32 = 47;
const DEVICE_CHAIN: i32 = 48;

/// Functions of the next layer, taken from the first instance and device: they are the same for all.
static INSTANCE: OnceLock<vk::PFN_vkGetInstanceProcAddr> = OnceLock::new();
static DEVICE: OnceLock<vk::PFN_vkGetDeviceProcAddr> = OnceLock::new();
static SUBMIT: OnceLock<vk::PFN_vkQueueSubmit> = OnceLock::new();
static WAIT_FENCES: OnceLock<vk::PFN_vkWaitForFences> = OnceLock::new();
static WAIT_SEMAPHORES: OnceLock<vk::PFN_vkWaitSemaphores> = OnceLock::new();
static COUNTER: OnceLock<vk::PFN_vkGetSemaphoreCounterValue> = OnceLock::new();

static CREATE_BUFFER: OnceLock<vk::PFN_vkCreateBuffer> = OnceLock::new();
static ALLOCATE: OnceLock<vk::PFN_vkAllocateMemory> = OnceLock::new();

/// Number of opened devices, of submissions to the latest, of allocations, and whether the latest is lost.
static DEVICES: AtomicU32 = AtomicU32::new(0);
static SUBMISSIONS: AtomicU32 = AtomicU32::new(0);
static ALLOCATIONS: AtomicU32 = AtomicU32::new(0);
static LOST: AtomicBool = AtomicBool::new(false);

/// What the layer simulates.
#[derive(Clone, Copy, PartialEq)]
enum Loss {
    Submission,
    Wait,
    Upload,
    Memory,
}

/// The parsed `AARC_LOSE`.
#[derive(Clone, Copy)]
struct Plan {
    loss: Loss,
    /// Number of the call, from 1; of an upload, its least bytes.
    call: u32,
    /// Number of devices to lose.
    devices: u32,
}

fn plan() -> Plan {
    static PLAN: OnceLock<Plan> = OnceLock::new();
    *PLAN.get_or_init(|| {
        let text = std::env::var("AARC_LOSE").unwrap_or_default();
        let mut parts = text.split(':');
        let loss = match parts.next() {
            Some("wait") => Loss::Wait,
            Some("upload") => Loss::Upload,
            Some("memory") => Loss::Memory,
            _ => Loss::Submission,
        };
        let mut number = || parts.next().and_then(|number| number.parse().ok()).unwrap_or(u32::MAX);
        Plan { loss, call: number(), devices: number() }
    })
}

/// Entry point of the layer.
///
/// # Safety
/// `negotiation` is a valid pointer.
// SAFETY: no other library of the process has this name.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vkNegotiateLoaderLayerInterfaceVersion(
    negotiation: *mut Negotiation,
) -> vk::Result {
    // SAFETY: the loader passes a valid pointer.
    let negotiation = unsafe { &mut *negotiation };
    negotiation.version = negotiation.version.min(2);
    negotiation.instance = Some(instance_function);
    negotiation.device = Some(device_function);
    negotiation.physical_device = null();
    vk::Result::SUCCESS
}

/// The layer's link in the chain of a create info; advances the chain for the next layer.
///
/// # Safety
/// `next` is a chain that the loader made.
unsafe fn link(mut next: *mut c_void, s_type: i32) -> Option<(vk::PFN_vkGetInstanceProcAddr, *mut Link)> {
    while !next.is_null() {
        // SAFETY: every structure in the chain begins as this one does.
        let chain = unsafe { &mut *next.cast::<Chain>() };
        if chain.s_type == s_type && chain.function == 0 {
            let link = chain.link;
            // SAFETY: the loader has a link for each layer.
            let Link { next, instance, .. } = unsafe { &*link };
            chain.link = *next;
            return Some((*instance, link));
        }
        next = chain.next;
    }
    None
}

// SAFETY: called by the loader, as vkCreateInstance is.
unsafe extern "system" fn create_instance(
    info: *const vk::InstanceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    instance: *mut vk::Instance,
) -> vk::Result {
    // SAFETY: the loader's chain; what it leads to has the type that its name says.
    unsafe {
        let Some((below, _)) = link((*info).p_next.cast_mut(), INSTANCE_CHAIN) else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let create = below(vk::Instance::null(), c"vkCreateInstance".as_ptr());
        let create: vk::PFN_vkCreateInstance = transmute(create);
        let _ = INSTANCE.set(below);
        create(info, allocator, instance)
    }
}

// SAFETY: called by the loader, as vkCreateDevice is.
unsafe extern "system" fn create_device(
    adapter: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    device: *mut vk::Device,
) -> vk::Result {
    // SAFETY: the loader's chain; what it leads to has the types that their names say.
    unsafe {
        let Some((below, link)) = link((*info).p_next.cast_mut(), DEVICE_CHAIN) else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let Some(of_device) = (*link).device else { return vk::Result::ERROR_INITIALIZATION_FAILED };
        let create: vk::PFN_vkCreateDevice =
            transmute(below(vk::Instance::null(), c"vkCreateDevice".as_ptr()));
        let result = create(adapter, info, allocator, device);
        if result == vk::Result::SUCCESS {
            DEVICES.fetch_add(1, Ordering::Relaxed);
            SUBMISSIONS.store(0, Ordering::Relaxed);
            LOST.store(false, Ordering::Relaxed);
            let function = |name: &CStr| of_device(*device, name.as_ptr());
            let _ = DEVICE.set(of_device);
            function(c"vkQueueSubmit").map(|f| SUBMIT.set(transmute::<Any, vk::PFN_vkQueueSubmit>(f)));
            function(c"vkCreateBuffer")
                .map(|f| CREATE_BUFFER.set(transmute::<Any, vk::PFN_vkCreateBuffer>(f)));
            function(c"vkAllocateMemory")
                .map(|f| ALLOCATE.set(transmute::<Any, vk::PFN_vkAllocateMemory>(f)));
            function(c"vkWaitForFences")
                .map(|f| WAIT_FENCES.set(transmute::<Any, vk::PFN_vkWaitForFences>(f)));
            function(c"vkWaitSemaphores")
                .map(|f| WAIT_SEMAPHORES.set(transmute::<Any, vk::PFN_vkWaitSemaphores>(f)));
            function(c"vkGetSemaphoreCounterValue")
                .map(|f| COUNTER.set(transmute::<Any, vk::PFN_vkGetSemaphoreCounterValue>(f)));
        }
        result
    }
}

// SAFETY: called as vkQueueSubmit is.
unsafe extern "system" fn submit(
    queue: vk::Queue,
    count: u32,
    submits: *const vk::SubmitInfo<'_>,
    fence: vk::Fence,
) -> vk::Result {
    let Plan { loss, call, devices } = plan();
    let is_time = SUBMISSIONS.fetch_add(1, Ordering::Relaxed) + 1 >= call;
    let is_meant =
        matches!(loss, Loss::Submission | Loss::Wait) && DEVICES.load(Ordering::Relaxed) <= devices;
    let loses = is_meant && is_time;
    if LOST.load(Ordering::Relaxed) || loses && loss == Loss::Submission {
        LOST.store(true, Ordering::Relaxed);
        return vk::Result::ERROR_DEVICE_LOST;
    }
    // SAFETY: the caller's arguments, to the function of the same name.
    let result =
        SUBMIT.get().map_or(vk::Result::ERROR_DEVICE_LOST, |f| unsafe { f(queue, count, submits, fence) });
    LOST.fetch_or(loses, Ordering::Relaxed);
    result
}

// SAFETY: called as vkCreateBuffer is.
unsafe extern "system" fn create_buffer(
    device: vk::Device,
    info: *const vk::BufferCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    buffer: *mut vk::Buffer,
) -> vk::Result {
    let Plan { loss, call, devices } = plan();
    // SAFETY: the caller passes a valid pointer.
    let is_large = unsafe { &*info }.size >= call.into();
    let loses = loss == Loss::Upload && is_large && DEVICES.load(Ordering::Relaxed) <= devices;
    LOST.fetch_or(loses, Ordering::Relaxed);
    // SAFETY: the caller's arguments, to the function of the same name.
    unless_lost(|| CREATE_BUFFER.get().map(|f| unsafe { f(device, info, allocator, buffer) }))
}

// SAFETY: called as vkAllocateMemory is.
unsafe extern "system" fn allocate(
    device: vk::Device,
    info: *const vk::MemoryAllocateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    memory: *mut vk::DeviceMemory,
) -> vk::Result {
    let Plan { loss, call, .. } = plan();
    if loss == Loss::Memory && ALLOCATIONS.fetch_add(1, Ordering::Relaxed) + 1 >= call {
        return vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
    }
    // SAFETY: the caller's arguments, to the function of the same name.
    unless_lost(|| ALLOCATE.get().map(|f| unsafe { f(device, info, allocator, memory) }))
}

/// The driver's result, unless the device is lost.
fn unless_lost(answer: impl FnOnce() -> Option<vk::Result>) -> vk::Result {
    match LOST.load(Ordering::Relaxed) {
        true => vk::Result::ERROR_DEVICE_LOST,
        false => answer().unwrap_or(vk::Result::ERROR_DEVICE_LOST),
    }
}

// SAFETY: called as vkWaitForFences is.
unsafe extern "system" fn wait_fences(
    device: vk::Device,
    count: u32,
    fences: *const vk::Fence,
    all: vk::Bool32,
    timeout: u64,
) -> vk::Result {
    // SAFETY: the caller's arguments, to the function of the same name.
    unless_lost(|| WAIT_FENCES.get().map(|f| unsafe { f(device, count, fences, all, timeout) }))
}

// SAFETY: called as vkWaitSemaphores is.
unsafe extern "system" fn wait_semaphores(
    device: vk::Device,
    info: *const vk::SemaphoreWaitInfo<'_>,
    timeout: u64,
) -> vk::Result {
    // SAFETY: the caller's arguments, to the function of the same name.
    unless_lost(|| WAIT_SEMAPHORES.get().map(|f| unsafe { f(device, info, timeout) }))
}

// SAFETY: called as vkGetSemaphoreCounterValue is.
unsafe extern "system" fn counter(
    device: vk::Device,
    semaphore: vk::Semaphore,
    value: *mut u64,
) -> vk::Result {
    // SAFETY: the caller's arguments, to the function of the same name.
    unless_lost(|| COUNTER.get().map(|f| unsafe { f(device, semaphore, value) }))
}

/// The function that this layer overrides under a name.
fn own(name: &CStr) -> vk::PFN_vkVoidFunction {
    let function: *const () = match name.to_bytes() {
        b"vkGetInstanceProcAddr" => instance_function as *const (),
        b"vkGetDeviceProcAddr" => device_function as *const (),
        b"vkCreateInstance" => create_instance as *const (),
        b"vkCreateDevice" => create_device as *const (),
        b"vkQueueSubmit" => submit as *const (),
        b"vkCreateBuffer" => create_buffer as *const (),
        b"vkAllocateMemory" => allocate as *const (),
        b"vkWaitForFences" => wait_fences as *const (),
        b"vkWaitSemaphores" | b"vkWaitSemaphoresKHR" => wait_semaphores as *const (),
        b"vkGetSemaphoreCounterValue" | b"vkGetSemaphoreCounterValueKHR" => counter as *const (),
        _ => null_mut(),
    };
    // SAFETY: a null pointer is none, and all others are functions of this interface.
    unsafe { transmute::<*const (), vk::PFN_vkVoidFunction>(function) }
}

// SAFETY: called as vkGetInstanceProcAddr is.
unsafe extern "system" fn instance_function(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: a name ends.
    let own = own(unsafe { CStr::from_ptr(name) });
    // SAFETY: the caller's arguments, to the layer below.
    own.or_else(|| INSTANCE.get().and_then(|below| unsafe { below(instance, name) }))
}

// SAFETY: called as vkGetDeviceProcAddr is.
unsafe extern "system" fn device_function(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: a name ends.
    let own = own(unsafe { CStr::from_ptr(name) });
    // SAFETY: the caller's arguments, to the layer below.
    own.or_else(|| DEVICE.get().and_then(|below| unsafe { below(device, name) }))
}
