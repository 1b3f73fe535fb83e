//! The point of view: sensor, film, sampler, and the integrator's limits.

use super::document::{Document, PluginId};
use super::properties::Properties;
use crate::scene::camera::{Camera, CameraError, FovAxis, Perspective};
use crate::scene::error::SceneError;
use crate::scene::{FilmSettings, PathLimits};
use glam::DVec2;

/// Most pixels of a picture. Feature buffers take about 400 bytes a pixel.
const MAX_PIXELS: u64 = 1 << 27;
/// Mitsuba's film where a scene names none.
const DEFAULT_SIZE: (u32, u32) = (768, 576);
/// Mitsuba's samples per pixel where a scene names none.
const DEFAULT_SAMPLES: u32 = 4;

/// What a sensor says.
pub(super) struct Sensor {
    pub(super) camera: Perspective,
    pub(super) film: FilmSettings,
    pub(super) samples: u32,
}

/// Reads a sensor with its film and sampler; `size` replaces the film's.
///
/// # Errors
/// An unknown plugin, or a property that is unknown or does not fit.
pub(super) fn sensor(
    document: &Document,
    id: PluginId,
    size: Option<(u32, u32)>,
    warnings: &mut Vec<String>,
) -> Result<Sensor, SceneError> {
    let mut properties = Properties::new(document, id);
    let film = match properties.plugin("film")? {
        Some(film) => self::film(document, film, size, warnings)?,
        None => {
            let (width, height) = size.unwrap_or(DEFAULT_SIZE);
            check_size(&properties, width, height)?;
            FilmSettings { width, height, crop: [0, 0, width, height] }
        }
    };
    let samples = match properties.plugin("sampler")? {
        Some(sampler) => self::sampler(document, sampler)?,
        None => DEFAULT_SAMPLES,
    };
    let camera = camera(&mut properties, &film)?;
    properties.finish()?;
    Ok(Sensor { camera, film, samples })
}

fn camera(properties: &mut Properties<'_>, film: &FilmSettings) -> Result<Perspective, SceneError> {
    let has_lens = match properties.name() {
        "perspective" => false,
        "thinlens" => true,
        _ => return Err(properties.unknown_plugin(&["perspective", "thinlens"])),
    };
    let (fov, fov_axis) = field_of_view(properties)?;
    let far_clip = properties.float("far_clip")?.unwrap_or(1e4);
    if has_lens && !properties.has("aperture_radius") {
        let what = format!("\"aperture_radius\" of {}", properties.title());
        return Err(SceneError::missing(properties.location(), what));
    }
    let aperture_radius =
        if has_lens { properties.float("aperture_radius")?.unwrap_or(0.0) } else { 0.0 };
    let principal_point_offset = DVec2::new(
        properties.float("principal_point_offset_x")?.unwrap_or(0.0),
        properties.float("principal_point_offset_y")?.unwrap_or(0.0),
    );
    let open = properties.float("shutter_open")?.unwrap_or(0.0);
    let close = properties.float("shutter_close")?.unwrap_or(0.0);
    if open > close {
        return Err(properties.wrong(
            "shutter_close",
            close.to_string(),
            "no less than shutter_open",
        ));
    }
    let camera = Perspective {
        to_world: properties.transform("to_world")?,
        fov,
        fov_axis,
        film: [film.width, film.height],
        principal_point_offset,
        near_clip: properties.float("near_clip")?.unwrap_or(1e-2),
        far_clip,
        aperture_radius,
        // A pinhole shows everything sharply, whatever the file says of it.
        focus_distance: properties.float("focus_distance")?.unwrap_or(far_clip),
    };
    Camera::perspective(&camera).map_err(|error| match error {
        CameraError::Range { name, found, expected } => {
            properties.wrong(name, found.to_string(), expected)
        }
        CameraError::Transform { .. } => {
            properties.wrong("to_world", "scaled or sheared", "turned and moved only")
        }
    })?;
    Ok(camera)
}

/// Degrees and the side of the picture that they span, from `fov` and `fov_axis` or from `focal_length`, as Mitsuba 3
/// defines them (`src/render/sensor.cpp`): focal lengths are those of a 36 × 24 mm film, along its diagonal.
fn field_of_view(properties: &mut Properties<'_>) -> Result<(f64, FovAxis), SceneError> {
    let axes = [
        ("x", FovAxis::X),
        ("y", FovAxis::Y),
        ("diagonal", FovAxis::Diagonal),
        ("smaller", FovAxis::Smaller),
        ("larger", FovAxis::Larger),
    ];
    let axis = properties.choice("fov_axis", &axes)?;
    let fov = properties.float("fov")?;
    let focal_length =
        if properties.has("focal_length") { Some(focal_length(properties)?) } else { None };
    match (fov, focal_length) {
        (Some(_), Some(_)) => {
            Err(properties.wrong("focal_length", "given beside fov", "one of them"))
        }
        (Some(fov), None) => Ok((fov, axis)),
        (None, length) => {
            let diagonal = 2.0 * (f64::hypot(36.0, 24.0) / (2.0 * length.unwrap_or(50.0))).atan();
            Ok((diagonal.to_degrees(), FovAxis::Diagonal))
        }
    }
}

fn focal_length(properties: &mut Properties<'_>) -> Result<f64, SceneError> {
    let text = properties.string("focal_length")?.unwrap_or_default();
    let millimetres = text.trim().trim_end_matches("mm").trim().parse::<f64>();
    match millimetres {
        Ok(length) if length.is_finite() && length > 0.0 => Ok(length),
        _ => Err(properties.wrong(
            "focal_length",
            format!("\"{text}\""),
            "millimetres like \"50mm\"",
        )),
    }
}

fn film(
    document: &Document,
    id: PluginId,
    size: Option<(u32, u32)>,
    warnings: &mut Vec<String>,
) -> Result<FilmSettings, SceneError> {
    let mut properties = Properties::new(document, id);
    if properties.name() != "hdrfilm" {
        return Err(properties.unknown_plugin(&["hdrfilm"]));
    }
    let mut side = |name, default| -> Result<i64, SceneError> {
        let pixels = properties.integer(name)?.unwrap_or(i64::from(default));
        if pixels < 1 || pixels > i64::from(u32::MAX) {
            return Err(properties.wrong(name, pixels.to_string(), "at least 1 pixel"));
        }
        Ok(pixels)
    };
    let (width, height) = (side("width", DEFAULT_SIZE.0)?, side("height", DEFAULT_SIZE.1)?);
    let crop_names = ["crop_offset_x", "crop_offset_y", "crop_width", "crop_height"];
    let mut crop = [0, 0, width, height];
    for (value, name) in crop.iter_mut().zip(crop_names) {
        *value = properties.integer(name)?.unwrap_or(*value);
    }
    // A crop that only has an offset keeps what is left of the film.
    for (axis, whole) in [(0, width), (1, height)] {
        if !properties.has(crop_names[axis + 2]) {
            crop[axis + 2] = whole.saturating_sub(crop[axis]);
        }
        if crop[axis] < 0 || crop[axis + 2] < 1 || crop[axis].saturating_add(crop[axis + 2]) > whole
        {
            let found = format!("{} pixels from {}", crop[axis + 2], crop[axis]);
            return Err(properties.wrong(
                crop_names[axis],
                found,
                format!("a part of the film's {whole} pixels"),
            ));
        }
    }
    for filter in properties.plugins("rfilter") {
        let filter = &document[filter];
        if filter.name != "box" {
            let (name, location) = (&filter.name, &filter.location);
            warnings.push(format!(
                "{location}: rfilter \"{name}\" replaced by \"box\", the only one here"
            ));
        }
    }
    // How Mitsuba would write the file; ours holds every channel in single precision.
    properties.ignore(&[
        "file_format",
        "pixel_format",
        "component_format",
        "compensate",
        "sample_border",
    ]);
    properties.ignore(&[
        "high_quality_edges",
        "banner",
        "gamma",
        "exposure",
        "tonemap_method",
        "has_alpha",
    ]);
    let size = size.unwrap_or((width as u32, height as u32));
    check_size(&properties, size.0, size.1)?;
    properties.finish()?;
    Ok(resize(width, height, crop, size))
}

fn check_size(properties: &Properties<'_>, width: u32, height: u32) -> Result<(), SceneError> {
    if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
        let expected = format!("at least 1 and at most {MAX_PIXELS} pixels");
        return Err(properties.wrong("width", format!("{width}x{height} pixels"), expected));
    }
    Ok(())
}

/// The film at another size: the crop shows the same part of the picture, rounded to whole pixels.
fn resize(width: i64, height: i64, crop: [i64; 4], size: (u32, u32)) -> FilmSettings {
    let (new_width, new_height) = (i64::from(size.0), i64::from(size.1));
    let scale = |first: i64, count: i64, old: i64, new: i64| {
        let start = (first * new / old).min(new - 1);
        let end = ((first + count) * new / old).clamp(start + 1, new);
        (start as u32, (end - start) as u32)
    };
    let (left, columns) = scale(crop[0], crop[2], width, new_width);
    let (top, rows) = scale(crop[1], crop[3], height, new_height);
    FilmSettings { width: size.0, height: size.1, crop: [left, top, columns, rows] }
}

/// Samples per pixel. How points are chosen is this renderer's own affair, so every sampler of Mitsuba will do.
fn sampler(document: &Document, id: PluginId) -> Result<u32, SceneError> {
    let known = [
        "halton",
        "hammersley",
        "independent",
        "ldsampler",
        "multijitter",
        "orthogonal",
        "sobol",
        "stratified",
    ];
    let mut properties = Properties::new(document, id);
    if !known.contains(&properties.name()) {
        return Err(properties.unknown_plugin(&known));
    }
    let count = properties.integer("sample_count")?.unwrap_or(DEFAULT_SAMPLES.into());
    properties.ignore(&["seed", "jitter", "strength", "dimension", "scramble"]);
    let count = u32::try_from(count).ok().filter(|count| *count > 0);
    let count =
        count.ok_or_else(|| properties.wrong("sample_count", "out of range", "at least 1"))?;
    properties.finish()?;
    Ok(count)
}

/// The limits of Mitsuba's `path` where a scene names no integrator.
pub(super) const DEFAULT_LIMITS: PathLimits =
    PathLimits { max_depth: None, rr_depth: PathLimits::DEFAULT_RR_DEPTH, hide_emitters: false };

/// How long paths may be, from a `path` or `direct` integrator.
///
/// # Errors
/// An unknown plugin, or a property that is unknown or does not fit.
pub(super) fn integrator(
    document: &Document,
    id: PluginId,
    warnings: &mut Vec<String>,
) -> Result<PathLimits, SceneError> {
    let mut properties = Properties::new(document, id);
    let mut limits = DEFAULT_LIMITS;
    limits.hide_emitters = properties.boolean("hide_emitters", false)?;
    match properties.name() {
        "path" => {
            limits.max_depth = match properties.integer("max_depth")?.unwrap_or(-1) {
                -1 => None,
                depth => Some(u32::try_from(depth).map_err(|_| {
                    properties.wrong(
                        "max_depth",
                        depth.to_string(),
                        "-1 for no limit, or 0 and more",
                    )
                })?),
            };
            let depth =
                properties.integer("rr_depth")?.unwrap_or(PathLimits::DEFAULT_RR_DEPTH.into());
            let valid = u32::try_from(depth).ok().filter(|depth| *depth > 0);
            limits.rr_depth = valid
                .ok_or_else(|| properties.wrong("rr_depth", depth.to_string(), "at least 1"))?;
            // Of versions before 3: whether shading normals may disagree with geometric ones.
            properties.ignore(&["strict_normals"]);
        }
        "direct" => {
            limits.max_depth = Some(2);
            let counts = ["shading_samples", "emitter_samples", "bsdf_samples", "strict_normals"];
            if counts.iter().any(|name| properties.has(name)) {
                let location = properties.location();
                warnings.push(format!(
                    "{location}: sample counts of integrator \"direct\" have no effect"
                ));
            }
            properties.ignore(&counts);
        }
        _ => return Err(properties.unknown_plugin(&["direct", "path"])),
    }
    properties.finish()?;
    Ok(limits)
}
