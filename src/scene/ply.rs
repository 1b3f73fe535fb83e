//! PLY meshes (Stanford polygon format), ascii and binary.
//!
//! Vertices: `x y z`, optional `nx ny nz`, optional texture coordinates named `u v`, `s t` or `texture_u texture_v`, of
//! any number type. Faces: the list `vertex_indices` or `vertex_index`; polygons become triangle fans. Other elements
//! and properties are passed over.

use super::mesh_file::{MeshError, RawMesh};
use glam::{DVec3, Vec2, Vec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    BeginList, ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult,
    PropertyType, ScalarType,
};
use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::Path;

/// Elements parsed at a time: enough that the call does not count, few enough that what the parser allocates is small
/// beside the mesh.
const BATCH: usize = 1 << 14;

/// Reads a PLY file. `flip_tex_coords` replaces `v` by `1 − v`; Mitsuba does so only when asked to.
///
/// # Errors
/// The file cannot be read, is truncated, is not a PLY file with vertices and faces, or a face names a vertex that does
/// not exist. Vertices that are not finite are counted in the warnings.
pub fn load(path: &Path, flip_tex_coords: bool) -> Result<RawMesh, MeshError> {
    let file = File::open(path).map_err(|error| MeshError::io(path, error))?;
    let length = file.metadata().map_err(|error| MeshError::io(path, error))?.len();
    let mut reader = Reader::new(BufReader::with_capacity(1 << 16, file));
    let header = Parser::<Skipped>::new()
        .read_header(&mut reader)
        .map_err(|error| parse_error(path, &error, true))?;
    check_header(path, &header, length)?;

    let mut mesh = RawMesh::default();
    let mut faces_without_area = 0usize;
    for element in header.elements.values() {
        match element.name.as_str() {
            "vertex" => {
                let layout = VertexLayout::of(element);
                read::<Vertex>(path, &mut reader, &header, element, |vertex| {
                    mesh.positions.push(vertex.position);
                    if layout.normals {
                        mesh.normals.push(vertex.normal);
                    }
                    if layout.uvs {
                        let [u, v] = vertex.uv.to_array();
                        mesh.uvs.push(Vec2::new(u, if flip_tex_coords { 1.0 - v } else { v }));
                    }
                })?;
            }
            "face" => read::<Face>(path, &mut reader, &header, element, |face| {
                let indices = face.indices();
                if indices.len() < 3 {
                    faces_without_area += 1;
                }
                for k in 2..indices.len() {
                    mesh.triangles.push([indices[0], indices[k - 1], indices[k]]);
                }
            })?,
            name => {
                read::<Skipped>(path, &mut reader, &header, element, |_| ())?;
                mesh.warnings.push(format!("{}: element '{name}' has no effect", path.display()));
            }
        }
    }

    let count = mesh.positions.len();
    let stray = mesh.triangles.iter().position(|t| t.iter().any(|&index| index as usize >= count));
    if let Some(triangle) = stray {
        let message = format!(
            "triangle {triangle} has the vertex indices {:?}, but there are {count} vertices",
            // Negative indices were read as the large unsigned numbers of the same bits.
            mesh.triangles[triangle].map(|index| index as i32)
        );
        return Err(MeshError::malformed(path, None, message));
    }
    if faces_without_area > 0 {
        mesh.warnings.push(format!(
            "{}: {faces_without_area} faces have fewer than three vertices; left out",
            path.display()
        ));
    }
    mesh.sanitise(path);
    Ok(mesh)
}

/// Reads all of `element`, giving each to `take`.
fn read<E: PropertyAccess>(
    path: &Path,
    reader: &mut Reader<BufReader<File>>,
    header: &Header,
    element: &ElementDef,
    mut take: impl FnMut(E),
) -> Result<(), MeshError> {
    let parser = Parser::<E>::new();
    let mut batch = element.clone();
    let mut done = 0;
    while done < element.count {
        batch.count = BATCH.min(element.count - done);
        let elements =
            parser.read_payload_for_element(reader, &batch, header).map_err(|error| {
                if error.kind() == ErrorKind::UnexpectedEof {
                    let message = format!(
                        "the file ends within the {} elements '{}' that its header promises",
                        element.count, element.name
                    );
                    MeshError::malformed(path, None, message)
                } else {
                    parse_error(path, &error, header.encoding == Encoding::Ascii)
                }
            })?;
        elements.into_iter().for_each(&mut take);
        done += batch.count;
    }
    Ok(())
}

fn parse_error(path: &Path, error: &ParseError, lines_count: bool) -> MeshError {
    let line = error.line().filter(|_| lines_count);
    // The parser's message begins with the line that is given apart, and ends with the state of its grammar.
    let message = error.to_string();
    let prefix = format!("Line {}: ", error.line().unwrap_or(0));
    let message = message.strip_prefix(&prefix).unwrap_or(&message);
    let message = message.split("\n\tError:").next().unwrap_or(message);
    let message: Vec<&str> = message.split_whitespace().collect();
    MeshError::malformed(path, line, format!("not a valid PLY file: {}", message.join(" ")))
}

/// Refuses headers without a mesh, and counts that the file's length cannot hold: a damaged count must not keep the
/// reader busy or fill the memory.
fn check_header(path: &Path, header: &Header, length: u64) -> Result<(), MeshError> {
    let refuse = |message: String| Err(MeshError::malformed(path, None, message));
    let (Some(vertex), Some(face)) = (header.elements.get("vertex"), header.elements.get("face"))
    else {
        let names: Vec<&str> = header.elements.keys().map(String::as_str).collect();
        return refuse(format!("expected the elements 'vertex' and 'face', found {names:?}"));
    };
    for name in ["x", "y", "z"] {
        if !is_scalar(vertex, name) {
            return refuse(format!("element 'vertex' has no number '{name}'"));
        }
    }
    let is_list = |name: &str| {
        face.properties.get(name).is_some_and(|p| matches!(p.data_type, PropertyType::List(..)))
    };
    if !INDEX_LISTS.iter().any(|name| is_list(name)) {
        return refuse(format!("element 'face' has none of the lists {INDEX_LISTS:?}"));
    }

    let mut least = 0u64;
    for element in header.elements.values() {
        let one = match header.encoding {
            // A value and what separates it from the next.
            Encoding::Ascii => 2 * element.properties.len().max(1) as u64 - 1,
            _ => element.properties.values().map(|p| smallest_size(&p.data_type)).sum(),
        };
        if one == 0 && element.count > 0 {
            return refuse(format!("element '{}' has no properties", element.name));
        }
        least = least.saturating_add(one.saturating_mul(element.count as u64));
    }
    if least > length {
        return refuse(format!(
            "the file is truncated: its header promises at least {least} bytes, it has {length}"
        ));
    }
    Ok(())
}

const INDEX_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

fn is_scalar(element: &ElementDef, name: &str) -> bool {
    element.properties.get(name).is_some_and(|p| matches!(p.data_type, PropertyType::Scalar(_)))
}

fn smallest_size(data_type: &PropertyType) -> u64 {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = data_type;
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Which optional properties the vertices have.
struct VertexLayout {
    normals: bool,
    uvs: bool,
}

impl VertexLayout {
    fn of(vertex: &ElementDef) -> Self {
        let has = |names: &[&str]| names.iter().all(|name| is_scalar(vertex, name));
        Self {
            normals: has(&["nx", "ny", "nz"]),
            uvs: has(&["u", "v"]) || has(&["s", "t"]) || has(&["texture_u", "texture_v"]),
        }
    }
}

#[derive(Default)]
struct Vertex {
    position: DVec3,
    normal: Vec3,
    uv: Vec2,
}

impl Vertex {
    fn set(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        match name {
            "x" => self.position.x = value,
            "y" => self.position.y = value,
            "z" => self.position.z = value,
            "nx" => self.normal.x = value as f32,
            "ny" => self.normal.y = value as f32,
            "nz" => self.normal.z = value as f32,
            "u" | "s" | "texture_u" => self.uv.x = value as f32,
            "v" | "t" | "texture_v" => self.uv.y = value as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let value = match property {
            Property::Char(value) => f64::from(value),
            Property::UChar(value) => f64::from(value),
            Property::Short(value) => f64::from(value),
            Property::UShort(value) => f64::from(value),
            Property::Int(value) => f64::from(value),
            Property::UInt(value) => f64::from(value),
            Property::Float(value) => f64::from(value),
            Property::Double(value) => value,
            _ => return PropertyAccessResult::Ignored,
        };
        self.set(name, value)
    }
}

/// The two commonest list types are filled in place; the others are converted.
#[derive(Default)]
struct Face {
    signed: Vec<i32>,
    unsigned: Vec<u32>,
}

impl Face {
    /// Negative indices become large numbers that no mesh reaches.
    fn indices(self) -> Vec<u32> {
        if self.signed.is_empty() {
            self.unsigned
        } else {
            self.signed.into_iter().map(|index| index as u32).collect()
        }
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn begin_list_int(&mut self, name: &str, _length: usize) -> BeginList<'_, i32> {
        if INDEX_LISTS.contains(&name) {
            BeginList::Fill(&mut self.signed)
        } else {
            BeginList::UseSetter
        }
    }

    fn begin_list_uint(&mut self, name: &str, _length: usize) -> BeginList<'_, u32> {
        if INDEX_LISTS.contains(&name) {
            BeginList::Fill(&mut self.unsigned)
        } else {
            BeginList::UseSetter
        }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !INDEX_LISTS.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.signed = match property {
            Property::ListChar(list) => list.into_iter().map(i32::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i32::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i32::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i32::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element whose properties do not matter.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

#[cfg(test)]
mod tests;
