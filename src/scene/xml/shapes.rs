//! Shapes: where a surface is. What it is made of and whether it shines is asked of the nested plugins.

use super::properties::Properties;
use crate::math::rigid::rotation_and_scale;
use crate::scene::build::Shape;
use crate::scene::error::SceneError;
use crate::scene::mesh_file::{MeshOptions, RawMesh};
use crate::scene::{obj, ply};
use glam::{DMat3, DMat4, DVec2, DVec3, Vec2};
use std::f64::consts::{PI, TAU};

/// The shape plugins known.
const KNOWN: [&str; 7] = ["cube", "cylinder", "disk", "obj", "ply", "rectangle", "sphere"];

/// Reads the shape itself: everything but its `bsdf` and `emitter`.
///
/// Spheres and cylinders become fine meshes where the transform leaves no sphere or circular cylinder, and
/// where one that is turned has a texture or a material that follows a direction: analytic shapes have their texture
/// coordinates along the axes of the world.
///
/// # Errors
/// An unknown plugin, a property that does not fit, or a mesh file that cannot be read.
pub(super) fn shape(
    properties: &mut Properties<'_>,
    has_pattern: bool,
    warnings: &mut Vec<String>,
) -> Result<Shape, SceneError> {
    let to_world = properties.transform("to_world")?;
    let flip_normals = properties.boolean("flip_normals", false)?;
    // Only differentiable renderers sample silhouettes.
    properties.ignore(&["silhouette_sampling_weight"]);
    match properties.name() {
        "obj" => mesh(properties, to_world, flip_normals, true, obj::load, warnings),
        "ply" => mesh(properties, to_world, flip_normals, false, ply::load, warnings),
        "rectangle" => Ok(built_in(rectangle(), to_world, flip_normals)),
        "cube" => Ok(built_in(cube(), to_world, flip_normals)),
        "disk" => {
            let axes = [DVec3::X, DVec3::Y].map(|axis| to_world.transform_vector3(axis));
            let center = to_world.transform_point3(DVec3::ZERO);
            // Mitsuba's normal is that of the object, which a mirror turns against the cross product of the axes.
            Ok(Shape::Disk { center, axes, flip_normals: flip_normals != is_mirror(&to_world) })
        }
        "sphere" => sphere(properties, to_world, flip_normals, has_pattern),
        "cylinder" => cylinder(properties, to_world, flip_normals, has_pattern),
        _ => Err(properties.unknown_plugin(&KNOWN)),
    }
}

type Loader = fn(&std::path::Path, bool) -> Result<RawMesh, crate::scene::mesh_file::MeshError>;

fn mesh(
    properties: &mut Properties<'_>,
    to_world: DMat4,
    flip_normals: bool,
    flips_tex_coords: bool,
    load: Loader,
    warnings: &mut Vec<String>,
) -> Result<Shape, SceneError> {
    let path = properties.file()?;
    let face_normals = properties.boolean("face_normals", false)?;
    let flip_tex_coords = properties.boolean("flip_tex_coords", flips_tex_coords)?;
    let mut mesh = load(&path, flip_tex_coords)
        .map_err(|error| SceneError::asset(properties.location_of("filename"), error))?;
    warnings.append(&mut mesh.warnings);
    Ok(Shape::Mesh { mesh, to_world, options: MeshOptions { face_normals, flip_normals } })
}

fn built_in(mesh: RawMesh, to_world: DMat4, flip_normals: bool) -> Shape {
    Shape::Mesh { mesh, to_world, options: MeshOptions { face_normals: false, flip_normals } }
}

fn is_mirror(transform: &DMat4) -> bool {
    transform.determinant() < 0.0
}

/// `[-1, 1]²` in the plane z = 0, facing +z; uv is `[0, 1]²`.
fn rectangle() -> RawMesh {
    face(DVec3::X, DVec3::Y, DVec3::Z, DVec3::ZERO)
}

/// A square around `center` with the half-axes `u` and `v`, along which the texture coordinates run, and a normal.
fn face(u: DVec3, v: DVec3, normal: DVec3, center: DVec3) -> RawMesh {
    let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    let triangles =
        if u.cross(v).dot(normal) > 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
    RawMesh {
        positions: corners
            .map(|uv| center + u * (2.0 * uv.x - 1.0) + v * (2.0 * uv.y - 1.0))
            .to_vec(),
        normals: vec![normal.as_vec3(); 4],
        uvs: corners.map(|uv| uv.as_vec2()).to_vec(),
        triangles: triangles.to_vec(),
        warnings: Vec::new(),
    }
}

/// `[-1, 1]³`, facing outward; on each face uv is `[0, 1]²`, turned as in Mitsuba 3 (`src/shapes/cube.cpp`).
fn cube() -> RawMesh {
    let directions_of_uv = [
        [DVec3::Z, DVec3::X],
        [-DVec3::X, -DVec3::Z],
        [DVec3::Y, -DVec3::Z],
        [DVec3::Y, DVec3::X],
        [DVec3::Y, DVec3::Z],
        [-DVec3::Y, DVec3::X],
    ];
    let mut cube = RawMesh::default();
    for [u, v] in directions_of_uv {
        let normal = v.cross(u);
        append(&mut cube, face(u, v, normal, normal));
    }
    cube
}

fn append(mesh: &mut RawMesh, part: RawMesh) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(part.positions);
    mesh.normals.extend(part.normals);
    mesh.uvs.extend(part.uvs);
    mesh.triangles
        .extend(part.triangles.into_iter().map(|triangle| triangle.map(|index| first + index)));
}

/// A sphere by `center` and `radius`, by `to_world`, or both.
fn sphere(
    properties: &mut Properties<'_>,
    to_world: DMat4,
    flip_normals: bool,
    has_pattern: bool,
) -> Result<Shape, SceneError> {
    let center = properties.vector("center")?.unwrap_or(DVec3::ZERO);
    let radius = radius(properties)?;
    let to_world =
        to_world * DMat4::from_translation(center) * DMat4::from_scale(DVec3::splat(radius));
    if let Some((turn, radius)) = rotation_and_scale(DMat3::from_mat4(to_world))
        && (!has_pattern || turn.abs_diff_eq(DMat3::IDENTITY, 1e-6))
    {
        return Ok(Shape::Sphere {
            center: to_world.transform_point3(DVec3::ZERO),
            radius,
            flip_normals: flip_normals != is_mirror(&to_world),
        });
    }
    let (columns, rows) = (256, 128);
    let mesh = grid(columns, rows, |uv| {
        let (phi, theta) = (TAU * uv.x, PI * uv.y);
        let direction = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        (direction, direction)
    });
    Ok(built_in(mesh, to_world, flip_normals))
}

/// The open cylinder from `p0` to `p1`; a mesh wherever it is textured.
fn cylinder(
    properties: &mut Properties<'_>,
    to_world: DMat4,
    flip_normals: bool,
    has_pattern: bool,
) -> Result<Shape, SceneError> {
    let start = properties.vector("p0")?.unwrap_or(DVec3::ZERO);
    let end = properties.vector("p1")?.unwrap_or(DVec3::Z);
    let radius = radius(properties)?;
    let Some(axis) = (end - start).try_normalize() else {
        return Err(properties.wrong("p1", end.to_string(), "another point than p0"));
    };
    // Mitsuba starts the texture at the first of the same two vectors (Duff et al. 2017).
    let (s, t) = axis.any_orthonormal_pair();
    let [across, along] = [s, t].map(|axis| to_world.transform_vector3(axis * radius));
    // The length may be stretched as it likes.
    let direction = to_world.transform_vector3(axis).normalize() * across.length();
    let is_round = rotation_and_scale(DMat3::from_cols(across, along, direction)).is_some();
    if is_round && !has_pattern {
        return Ok(Shape::Cylinder {
            start: to_world.transform_point3(start),
            end: to_world.transform_point3(end),
            radius: across.length(),
            flip_normals: flip_normals != is_mirror(&to_world),
        });
    }
    let mesh = grid(512, 1, |uv| {
        let phi = TAU * uv.x;
        let normal = s * phi.cos() + t * phi.sin();
        (start.lerp(end, uv.y) + normal * radius, normal)
    });
    Ok(built_in(mesh, to_world, flip_normals))
}

fn radius(properties: &mut Properties<'_>) -> Result<f64, SceneError> {
    properties.float_in("radius", 1.0, "more than 0", |radius| radius > 0.0)
}

/// A curved surface over the unit square: `point` gives position and unit normal. Triangles that shrink to a line, as
/// at the poles of a sphere, are left out.
fn grid(columns: u32, rows: u32, point: impl Fn(DVec2) -> (DVec3, DVec3)) -> RawMesh {
    let mut mesh = RawMesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let uv = DVec2::new(
                f64::from(column) / f64::from(columns),
                f64::from(row) / f64::from(rows),
            );
            let (position, normal) = point(uv);
            mesh.positions.push(position);
            mesh.normals.push(normal.as_vec3());
            mesh.uvs.push(Vec2::new(uv.x as f32, uv.y as f32));
        }
    }
    let index = |row: u32, column: u32| row * (columns + 1) + column;
    for row in 0..rows {
        for column in 0..columns {
            let [a, b] = [index(row, column), index(row, column + 1)];
            let [c, d] = [index(row + 1, column), index(row + 1, column + 1)];
            for triangle in [[a, c, b], [b, c, d]] {
                let [p, q, r] = triangle.map(|corner| mesh.positions[corner as usize]);
                if (q - p).cross(r - p).length_squared() > 1e-24 {
                    mesh.triangles.push(triangle);
                }
            }
        }
    }
    mesh
}
