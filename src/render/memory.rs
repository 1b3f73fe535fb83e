//! Whether the picture fits in memory, found out before it is asked for.

use super::RenderSettings;
use crate::film::{Film, SplatFilm};
use crate::integrator::Integrator;
use crate::integrator::correlated_visibility::PixelSums;
use crate::scene::{FilmSettings, Requirements, Scene};

/// A picture that cannot be rendered here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotEnoughMemory {
    /// Its sums and layers are larger than what is free.
    #[error(
        "a picture of {columns}x{rows} pixels takes about {}, and {} of memory are available: ask for a smaller one",
        size(*needed), size(*available)
    )]
    Picture {
        /// Pixels across.
        columns: u32,
        /// Pixels down.
        rows: u32,
        /// Bytes that it takes.
        needed: u64,
        /// Bytes that there are.
        available: u64,
    },
    /// Its pixels cannot be numbered.
    #[error("a film of {width}x{height} pixels is too large: at most {} can be numbered", u32::MAX)]
    Film {
        /// Pixels across the whole film.
        width: u32,
        /// Pixels down the whole film.
        height: u32,
    },
}

/// Bytes in words.
fn size(bytes: u64) -> String {
    let units = ["bytes", "kB", "MB", "GB", "TB", "PB", "EB"];
    let mut number = bytes as f64;
    let mut unit = 0;
    while number >= 1000.0 && unit + 1 < units.len() {
        number /= 1000.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} bytes") } else { format!("{number:.1} {}", units[unit]) }
}

/// Refuses a picture that does not fit in memory, its films and layers counted: the system would end the process in the
/// middle of the work.
///
/// # Errors
/// [`NotEnoughMemory`].
pub fn check_memory(scene: &Scene, settings: &RenderSettings) -> Result<(), NotEnoughMemory> {
    let FilmSettings { width, height, crop: [_, _, columns, rows] } = scene.film;
    if width.checked_mul(height).is_none() {
        return Err(NotEnoughMemory::Film { width, height });
    }
    let needed = bytes(scene, settings);
    let available = available();
    let fits = available.is_none_or(|available| needed <= available);
    // Also where the system does not tell, or the process has a limit of its own.
    let asked =
        usize::try_from(needed).is_ok_and(|n| Vec::<u8>::new().try_reserve_exact(n).is_ok());
    if fits && asked {
        return Ok(());
    }
    let available = available.unwrap_or(0).min(needed);
    Err(NotEnoughMemory::Picture { columns, rows, needed, available })
}

/// Bytes that the films and the layers of a render take.
pub(super) fn bytes(scene: &Scene, settings: &RenderSettings) -> u64 {
    let (film, requirements) = (scene.film, Requirements::of(scene));
    let features = Film::bytes(film, &requirements);
    let radiance = Film::radiance_bytes(film, &requirements);
    let splats = SplatFilm::bytes(film, true);
    let more = match settings.integrator {
        // The films of the pilot and of the rest.
        Integrator::Path(_) if settings.is_adaptive => features,
        Integrator::Path(_) => 0,
        Integrator::Bdpt(_) | Integrator::Pssmlt(_) | Integrator::Mlt(_) => splats + radiance,
        Integrator::Erpt(erpt) => {
            let proposals = if erpt.proposal_limit.is_some() { splats } else { 0 };
            splats.saturating_add(radiance).saturating_add(proposals)
        }
        Integrator::Visibility(_) => {
            film.crop_pixels().saturating_mul(2 * size_of::<PixelSums>() as u64)
        }
    };
    features.saturating_add(more).saturating_add(Film::layer_bytes(film, &requirements))
}

/// Bytes of memory that the system has free or can make so, swap included, within the limit of the process's control group;
/// `None` where it does not tell.
fn available() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let facts = read("/proc/meminfo")?;
    let system = field(&facts, "MemAvailable:")?.saturating_add(field(&facts, "SwapFree:")?);
    let group = |name: &str| read(&format!("/sys/fs/cgroup/{name}"))?.trim().parse::<u64>().ok();
    let of_group = group("memory.max").zip(group("memory.current"));
    let left = of_group.map(|(most, taken)| most.saturating_sub(taken));
    Some(left.map_or(system, |left| left.min(system)))
}

/// A number of kilobytes in `/proc/meminfo`, in bytes.
fn field(facts: &str, name: &str) -> Option<u64> {
    let line = facts.lines().find_map(|line| line.strip_prefix(name))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kilobytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_told_in_words() {
        let words = [0, 999, 1500, 23_400_000_000, u64::MAX].map(size);
        assert_eq!(words, ["0 bytes", "999 bytes", "1.5 kB", "23.4 GB", "18.4 EB"]);
    }

    #[test]
    fn free_memory_is_read_off_the_systems_list() {
        let facts = "MemTotal:  100 kB\nMemAvailable:      23 kB\nSwapFree:  2 kB\n";
        assert_eq!(field(facts, "MemAvailable:"), Some(23 * 1024));
        assert_eq!(field(facts, "Swap:"), None);
        #[cfg(target_os = "linux")]
        assert!(available().is_some_and(|bytes| bytes > 1 << 20));
    }
}
