//! Which adapter renders.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use kestrel_sim::camera::{Backend, RenderError};
use wgpu::{Adapter, Backends, DeviceType, Instance, InstanceDescriptor};

/// The best adapter of a kind.
pub(super) fn find(backend: Backend) -> Result<Adapter, RenderError> {
    let instance = Instance::new(InstanceDescriptor::new_without_display_handle_from_env());
    let mut adapters = wait(instance.enumerate_adapters(Backends::all()));
    let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
    adapters.sort_by_key(|adapter| rank(adapter.get_info().device_type));
    let wanted =
        |adapter: &Adapter| (adapter.get_info().device_type == DeviceType::Cpu) == (backend == Backend::Software);
    let found = adapters.into_iter().find(|adapter| backend != Backend::Cpu && wanted(adapter));
    found.ok_or_else(|| missing(backend, &names))
}

/// Those that have memory of their own first.
fn rank(kind: DeviceType) -> u8 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::VirtualGpu => 1,
        DeviceType::IntegratedGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

fn missing(backend: Backend, names: &[String]) -> RenderError {
    let (wanted, advice) = match backend {
        Backend::Auto | Backend::Gpu => ("GPU", "install its driver, or ask for the backend `cpu`"),
        Backend::Software => ("software adapter", "install mesa-vulkan-drivers, or ask for the backend `cpu`"),
        Backend::Cpu => ("adapter for the backend `cpu`", "it renders without one"),
    };
    let found = match (names, backend) {
        ([], _) => "no driver at all".to_owned(),
        (names, Backend::Auto | Backend::Gpu) => format!("only software: {}", names.join(", ")),
        (names, Backend::Software | Backend::Cpu) => format!("only {}", names.join(", ")),
    };
    RenderError::NoAdapter { wanted, found, advice }
}

/// What a future has to say that never waits for another thread, as those of wgpu for native devices.
pub(super) fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
        std::thread::yield_now();
    }
}
