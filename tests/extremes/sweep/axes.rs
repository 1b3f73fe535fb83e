//! What is swept over, and what should come of it.

use crate::support::scenes::{scene_around, scene_from};
use quietlight::scene::Scene;

/// A value of an axis.
pub(super) struct Point {
    /// As the table names it.
    pub(super) value: String,
    pub(super) scene: Scene,
    /// Samples or mutations per pixel.
    pub(super) samples: u32,
    pub(super) expected: Expected,
    /// Is it what time is compared with?
    pub(super) is_base: bool,
}

/// What a picture should be.
pub(super) enum Expected {
    /// Every pixel has this radiance, of all colours.
    Radiance(f64),
    /// The picture that path tracing gives of a room, times a factor.
    Traced { room: Room, factor: f64 },
}

/// One axis.
pub(super) struct Axis {
    pub(super) name: &'static str,
    /// What the pictures are and what they are compared with, for the reader of the table.
    pub(super) meaning: &'static str,
    pub(super) points: Vec<Point>,
}

/// Which values: the ends of the axes, or many.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Form {
    Short,
    Long,
}

/// What the room is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Room {
    pub(super) size: [u32; 2],
    pub(super) scale: f64,
    pub(super) offset: f64,
    pub(super) radiance: f64,
    pub(super) alpha: f64,
}

impl Default for Room {
    fn default() -> Self {
        Self { size: [12, 12], scale: 1.0, offset: 0.0, radiance: 1.0, alpha: 0.2 }
    }
}

impl Room {
    /// Two walls and a floor, a ball of rough copper and one of rough glass, a lamp and a sky.
    pub(super) fn scene(&self) -> Scene {
        let Self { size: [width, height], scale, offset, radiance, alpha } = *self;
        let to_world = |before: &str| {
            format!(
                r#"<transform name="to_world">{before}<scale value="{scale}"/><translate x="{offset}"/></transform>"#
            )
        };
        let (eye, near, far) = (4.0 * scale, 0.01 * scale, 1e4 * scale);
        let lamp = [6.0, 5.0, 4.0].map(|value| value * radiance);
        let sky = [0.2, 0.3, 0.4].map(|value| value * radiance);
        let grey = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.6 0.5 0.4"/></bsdf></bsdf>"#;
        scene_from(&format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="5"/></integrator>
            <sensor type="perspective"><float name="fov" value="45"/>
                <float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/>
                <transform name="to_world"><lookat origin="{offset},{scale},{eye}" target="{offset},0,0" up="0,1,0"/></transform>
                <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
                    <rfilter type="box"/></film></sensor>
            <shape type="rectangle">{}{grey}</shape>
            <shape type="rectangle">{}{grey}</shape>
            <shape type="sphere">{}<bsdf type="roughconductor"><string name="material" value="Cu"/>
                <float name="alpha" value="{alpha}"/></bsdf></shape>
            <shape type="sphere">{}<bsdf type="roughdielectric"><float name="alpha" value="{alpha}"/></bsdf></shape>
            <shape type="rectangle">{}
                <emitter type="area"><rgb name="radiance" value="{} {} {}"/></emitter></shape>
            <emitter type="constant"><rgb name="radiance" value="{} {} {}"/></emitter></scene>"#,
            to_world(r#"<rotate x="1" angle="-90"/><scale value="3"/><translate y="-1"/>"#),
            to_world(r#"<scale value="3"/><translate z="-2"/>"#),
            to_world(r#"<scale value="0.7"/><translate x="-0.8" y="-0.3"/>"#),
            to_world(r#"<scale value="0.6"/><translate x="0.8" y="-0.4" z="0.3"/>"#),
            to_world(r#"<rotate x="1" angle="90"/><scale value="0.8"/><translate y="2"/>"#),
            lamp[0],
            lamp[1],
            lamp[2],
            sky[0],
            sky[1],
            sky[2],
        ))
    }
}

/// The inside of a diffuse sphere that shines with radiance 1, and what is seen in it: `Σ ρ^k` over the edges.
fn furnace(size: [u32; 2], albedo: f64, edges: u32) -> (Scene, f64) {
    let mut scene = scene_around(
        8,
        60.0,
        edges as i32,
        &format!(
            r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
            <bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#
        ),
    );
    if size != [8, 8] {
        let [width, height] = size;
        scene = scene_from(&format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{edges}"/></integrator>
            <sensor type="perspective"><float name="fov" value="60"/><string name="fov_axis" value="larger"/>
                <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
                <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
                    <rfilter type="box"/></film></sensor>
            <shape type="sphere"><boolean name="flip_normals" value="true"/>
            <bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape></scene>"#
        ));
    }
    (scene, (0..edges).map(|k| albedo.powi(k as i32)).sum())
}

/// All axes.
pub(super) fn axes(form: Form) -> Vec<Axis> {
    let is_long = form == Form::Long;
    let samples = if is_long { 16 } else { 8 };
    // All values, or the ends alone.
    let values = |all: &[f64], ends: &[f64]| if is_long { all.to_vec() } else { ends.to_vec() };
    let base = Room::default();
    let of_room = |value: f64, room: Room, factor: f64, is_base: bool| Point {
        value: format!("{value:e}"),
        scene: room.scene(),
        samples,
        expected: Expected::Traced { room: base, factor },
        is_base,
    };
    let of_furnace = |value: String, size, albedo, edges, samples, is_base| {
        let (scene, radiance) = furnace(size, albedo, edges);
        Point { value, scene, samples, expected: Expected::Radiance(radiance), is_base }
    };
    vec![
        Axis {
            name: "Scale",
            meaning: "all lengths of a room times the value; against path tracing of scale 1",
            points: values(&[1.0, 1e-4, 1e-2, 1e4, 1e7], &[1e7])
                .into_iter()
                .map(|scale| of_room(scale, Room { scale, ..base }, 1.0, scale == 1.0))
                .collect(),
        },
        Axis {
            name: "Offset",
            meaning: "the room so many of its units away from the origin; against path tracing at the origin",
            points: values(&[0.0, 1e2, 1e4, 1e6], &[1e6])
                .into_iter()
                .map(|offset| of_room(offset, Room { offset, ..base }, 1.0, offset == 0.0))
                .collect(),
        },
        Axis {
            name: "Radiance",
            meaning: "all light of the room times the value; against path tracing times the value",
            points: values(&[1.0, 1e-8, 1e-4, 1e4, 1e8], &[1e-8, 1e8])
                .into_iter()
                .map(|radiance| {
                    of_room(radiance, Room { radiance, ..base }, radiance, radiance == 1.0)
                })
                .collect(),
        },
        Axis {
            name: "Roughness",
            meaning: "α of the copper and the glass; against path tracing of the same α by other seeds, and at 1e-4 and below of α = 0",
            points: values(&[0.2, 1.0, 0.1, 1e-2, 1e-3, 1e-4, 0.0], &[1e-3])
                .into_iter()
                .map(|alpha| {
                    let traced = Room { alpha: if alpha <= 1e-4 { 0.0 } else { alpha }, ..base };
                    let mut point = of_room(alpha, Room { alpha, ..base }, 1.0, alpha == 0.2);
                    point.expected = Expected::Traced { room: traced, factor: 1.0 };
                    point
                })
                .collect(),
        },
        Axis {
            name: "Depth",
            meaning: "most edges of a path, inside a shining sphere of albedo 0.9; against Σ 0.9^k",
            points: values(&[5.0, 1.0, 2.0, 50.0, 500.0], &[500.0])
                .into_iter()
                .map(|edges| {
                    of_furnace(format!("{edges}"), [8, 8], 0.9, edges as u32, samples, edges == 5.0)
                })
                .collect(),
        },
        Axis {
            name: "Albedo",
            meaning: "of a shining sphere seen from inside, paths of 64 edges; against Σ ρ^k",
            points: values(&[0.5, 0.0, 1e-12, 0.9, 0.99, 0.999, 0.9999], &[0.9999])
                .into_iter()
                .map(|albedo| {
                    of_furnace(format!("{albedo}"), [8, 8], albedo, 64, samples, albedo == 0.5)
                })
                .collect(),
        },
        Axis {
            name: "Size",
            meaning: "pixels of a picture of the inside of a shining sphere of albedo 0.5; against 1.9375. Time is per pixel",
            points: [[8, 8], [1, 1], [1, 64], [64, 1], [2, 2], [16384, 1], [1, 16384]]
                .into_iter()
                .filter(|&size| is_long || size == [1, 1])
                .map(|size: [u32; 2]| {
                    let large = size[0] * size[1] > 1000;
                    let samples = if large { 2 } else { samples };
                    of_furnace(
                        format!("{}×{}", size[0], size[1]),
                        size,
                        0.5,
                        5,
                        samples,
                        size == [8, 8],
                    )
                })
                .collect(),
        },
        Axis {
            name: "Samples",
            meaning: "samples or mutations per pixel, of four pixels of the room; against path tracing. Time is per sample",
            points: [64, 1, 2, 16, 1024, 65_536]
                .into_iter()
                .filter(|&samples| is_long || samples == 1)
                .map(|samples| {
                    let room = Room { size: [2, 2], ..base };
                    let expected = Expected::Traced { room, factor: 1.0 };
                    let value = samples.to_string();
                    Point { value, scene: room.scene(), samples, expected, is_base: samples == 64 }
                })
                .collect(),
        },
    ]
}
