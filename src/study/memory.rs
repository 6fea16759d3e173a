//! Whether the host has room for one more point.

use lrbsim_workloads::Scene;

use crate::host::bytes_of;
use crate::inputs::Machine;

/// The line of `/proc/meminfo` that says how much memory can be had.
const AVAILABLE: &str = "MemAvailable:";

/// Bytes of a point before pixels, triangles, caches and threads are counted.
const BASE_BYTES: u64 = 64 << 20;

/// Bytes that a point takes for each pixel: eye view, receivers, their columns and the picture.
const PIXEL_BYTES: u64 = 400;

/// Bytes that a point takes for each triangle: mesh, adjacency, hierarchy of the eye view, records of the bins.
const TRIANGLE_BYTES: u64 = 2500;

/// Bytes that a point takes for each line of its caches: tag, state, and directory entry.
const LINE_BYTES: u64 = 40;

/// Bytes that a point takes for each simulated hardware thread: its stream of uops.
const THREAD_BYTES: u64 = 1 << 20;

/// Memory that points of a scene take however many machines run it, generously.
pub fn of_scene(scene: &Scene) -> u64 {
    let pixels = u64::from(scene.image.width) * u64::from(scene.image.height);
    BASE_BYTES
        .saturating_add(pixels * PIXEL_BYTES)
        .saturating_add(scene.mesh.triangles.len() as u64 * TRIANGLE_BYTES)
}

/// Memory that a machine takes, generously.
pub fn of_machine(machine: &Machine) -> u64 {
    let config = &machine.config;
    let cores = u64::from(config.cores);
    let lines = (config.l1d.capacity_bytes + config.l2.capacity_bytes) / 64;
    let threads = cores.saturating_mul(u64::from(config.threads_per_core));
    cores
        .saturating_mul(lines)
        .saturating_mul(LINE_BYTES)
        .saturating_add(threads.saturating_mul(THREAD_BYTES))
}

/// Memory that points may take together: most of what is available, or no bound where the host does not tell.
pub fn budget() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let host = bytes_of(&text, AVAILABLE).unwrap_or(u64::MAX);
    // A container may be given less than the host has.
    let limit = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let used = std::fs::read_to_string("/sys/fs/cgroup/memory.current").ok();
    let number = |text: Option<String>| text.and_then(|text| text.trim().parse::<u64>().ok());
    let container = number(limit).map(|limit| limit.saturating_sub(number(used).unwrap_or(0)));
    host.min(container.unwrap_or(u64::MAX)) / 10 * 9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_available_is_found() {
        assert_eq!(bytes_of("MemTotal: 9 kB\nMemAvailable:   2048 kB\n", AVAILABLE), Some(2 << 20));
        assert_eq!(bytes_of("", AVAILABLE), None);
    }

    #[test]
    fn more_of_anything_takes_more() {
        let scene = crate::inputs::scene("tiny").expect("shipped");
        let load = |settings: &[&str]| {
            let settings: Vec<_> = settings.iter().map(|text| text.parse().expect("PATH=VALUE")).collect();
            of_scene(&scene) + of_machine(&Machine::load("larrabee-24", &settings).expect("sound"))
        };
        assert!(load(&["cores=1"]) < load(&[]) && load(&[]) < load(&["cores=1024"]));
        assert!(load(&["cores=1024"]) < 8 << 30, "{}", load(&["cores=1024"]));
    }
}
