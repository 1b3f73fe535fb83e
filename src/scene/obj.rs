//! Wavefront OBJ meshes.
//!
//! The text is first made regular, which finds every error with its line: indices become absolute and complete, lines
//! that say nothing of the mesh are dropped. `tobj` then reads the numbers and joins the indices.

use super::mesh_file::{MeshError, RawMesh};
use glam::{DVec3, Vec2};
use std::fmt::Write;
use std::path::Path;

/// Reads an OBJ file as one mesh, whatever groups, objects and materials it names. `flip_tex_coords` replaces `v` by
/// `1 − v`; Mitsuba does so unless told not to.
///
/// Vertices are shared where position, texture coordinate and normal index agree. Polygons become triangle fans; lines,
/// points and curves are passed over. A vertex without texture coordinate in a file that has some gets `(0, 0)`.
///
/// # Errors
/// The file cannot be read, a line of it cannot be parsed, an index is out of range, or there are no faces.
pub fn load(path: &Path, flip_tex_coords: bool) -> Result<RawMesh, MeshError> {
    let text = read_text(path)?;
    let regular = Regular::new(path, &text, false)?;
    let (models, _) = regular.parse(path, |_| Ok(Default::default()))?;
    let mut mesh = RawMesh { warnings: regular.warnings(path), ..RawMesh::default() };
    for model in models {
        append(&mut mesh, &model.mesh, &regular, flip_tex_coords);
    }
    if mesh.triangles.is_empty() {
        return Err(MeshError::malformed(path, None, "no faces"));
    }
    mesh.sanitise(path);
    Ok(mesh)
}

/// The file's text; bytes that are not UTF-8 (comments and names of old exporters) are replaced.
pub(super) fn read_text(path: &Path) -> Result<String, MeshError> {
    let bytes = std::fs::read(path).map_err(|error| MeshError::io(path, error))?;
    Ok(String::from_utf8(bytes)
        .unwrap_or_else(|error| String::from_utf8_lossy(error.as_bytes()).into_owned()))
}

/// Adds what `tobj` read to a mesh.
pub(super) fn append(
    mesh: &mut RawMesh,
    part: &tobj::Mesh,
    regular: &Regular,
    flip_tex_coords: bool,
) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(part.positions.chunks_exact(3).map(DVec3::from_slice));
    if regular.has_normals {
        let normals = part.normals.chunks_exact(3);
        mesh.normals.extend(normals.map(|n| DVec3::from_slice(n).as_vec3()));
    }
    if regular.has_uvs {
        let uvs = part.texcoords.chunks_exact(2).map(|uv| Vec2::new(uv[0] as f32, uv[1] as f32));
        mesh.uvs
            .extend(uvs.map(|uv| if flip_tex_coords { Vec2::new(uv.x, 1.0 - uv.y) } else { uv }));
    }
    let triangles = part.indices.chunks_exact(3);
    mesh.triangles.extend(triangles.map(|t| [first + t[0], first + t[1], first + t[2]]));
}

/// OBJ text in which every face names a position, a texture coordinate and a normal by absolute index.
///
/// Index 1 of texture coordinates and of normals is put there for faces that name none: `(0, 0)`, and the zero vector
/// that [`RawMesh`] reads as "none given".
pub(super) struct Regular {
    text: String,
    /// Does a face name a normal?
    pub(super) has_normals: bool,
    /// Does a face name a texture coordinate?
    pub(super) has_uvs: bool,
    flat_faces: usize,
    unknown: std::collections::BTreeMap<String, usize>,
}

/// How many of one kind there are so far, and the largest absolute index met, with its line.
#[derive(Default)]
struct Counter {
    name: &'static str,
    count: usize,
    largest: usize,
    line: usize,
}

impl Counter {
    /// The absolute index, from 1, that a face means by `word` at `line`.
    fn resolve(&mut self, path: &Path, line: usize, word: &str) -> Result<usize, MeshError> {
        let refuse = |message: String| MeshError::malformed(path, Some(line), message);
        let index: i64 = word
            .parse()
            .map_err(|_| refuse(format!("expected an index of a {}, found '{word}'", self.name)))?;
        let absolute = if index < 0 { self.count as i64 + 1 + index } else { index };
        if absolute < 1 {
            return Err(refuse(format!(
                "{} index {index} is out of range: there are {} so far",
                self.name, self.count
            )));
        }
        let absolute = absolute as usize;
        if absolute > self.largest {
            (self.largest, self.line) = (absolute, line);
        }
        Ok(absolute)
    }

    /// Faces may come before their vertices, so positive indices are compared with the final count.
    fn check(&self, path: &Path) -> Result<(), MeshError> {
        if self.largest <= self.count {
            return Ok(());
        }
        let message = format!(
            "{} index {} is out of range: there are {}",
            self.name, self.largest, self.count
        );
        Err(MeshError::malformed(path, Some(self.line), message))
    }
}

impl Regular {
    /// Makes `text` regular. Names of objects, groups and materials are kept only where `keep_names`.
    pub(super) fn new(path: &Path, text: &str, keep_names: bool) -> Result<Self, MeshError> {
        let mut regular = Self {
            text: String::with_capacity(text.len() * 3 / 2),
            has_normals: false,
            has_uvs: false,
            flat_faces: 0,
            unknown: Default::default(),
        };
        regular.text += "vt 0 0\nvn 0 0 0\n";
        let [mut positions, mut uvs, mut normals] = ["vertex", "texture coordinate", "normal"]
            .map(|name| Counter { name, ..Counter::default() });

        for (number, line) in logical_lines(text) {
            let line = line.as_ref();
            let mut words = line.split_whitespace();
            match words.next() {
                None => {}
                Some("v") => {
                    positions.count += 1;
                    // Vertex colours and weights that may follow say nothing here.
                    regular.numbers(path, number, "v", 3, 3, words)?;
                }
                Some("vt") => {
                    uvs.count += 1;
                    regular.numbers(path, number, "vt", 1, 2, words)?;
                }
                Some("vn") => {
                    normals.count += 1;
                    regular.numbers(path, number, "vn", 3, 3, words)?;
                }
                Some("f") => {
                    let start = regular.text.len();
                    regular.text.push('f');
                    let mut corners = 0usize;
                    for corner in words {
                        regular.corner(
                            path,
                            number,
                            corner,
                            [&mut positions, &mut uvs, &mut normals],
                        )?;
                        corners += 1;
                    }
                    regular.text.push('\n');
                    if corners < 3 {
                        regular.text.truncate(start);
                        regular.flat_faces += 1;
                    }
                }
                Some("o" | "g" | "usemtl" | "mtllib") if !keep_names => {}
                Some(word @ ("o" | "g" | "usemtl" | "mtllib")) => {
                    let name = line.trim()[word.len()..].trim();
                    writeln!(regular.text, "{word} {name}").expect("writing to a String succeeds");
                }
                // Smoothing groups serve only to compute normals that the file does not give.
                Some("s") => {}
                Some(word) if word.starts_with('#') => {}
                Some(word) => *regular.unknown.entry(word.to_owned()).or_default() += 1,
            }
        }
        for counter in [positions, uvs, normals] {
            counter.check(path)?;
        }
        Ok(regular)
    }

    /// Copies between `least` and `most` numbers after `keyword`; missing ones are 0.
    fn numbers<'a>(
        &mut self,
        path: &Path,
        line: usize,
        keyword: &str,
        least: usize,
        most: usize,
        mut words: impl Iterator<Item = &'a str>,
    ) -> Result<(), MeshError> {
        self.text += keyword;
        for k in 0..most {
            let word = words.next().unwrap_or(if k < least { "" } else { "0" });
            if word.parse::<f64>().is_err() {
                let message = format!("'{keyword}' expects {least} numbers, found '{word}'");
                return Err(MeshError::malformed(path, Some(line), message));
            }
            self.text.push(' ');
            self.text += word;
        }
        self.text.push('\n');
        Ok(())
    }

    /// Copies one corner of a face, `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(
        &mut self,
        path: &Path,
        line: usize,
        corner: &str,
        [positions, uvs, normals]: [&mut Counter; 3],
    ) -> Result<(), MeshError> {
        let mut parts = corner.split('/');
        let position = positions.resolve(path, line, parts.next().unwrap_or(""))?;
        let mut optional = |counter: &mut Counter| match parts.next() {
            None | Some("") => Ok(1),
            Some(word) => Ok(counter.resolve(path, line, word)? + 1),
        };
        let (uv, normal) = (optional(uvs)?, optional(normals)?);
        if parts.next().is_some() {
            let message = format!("expected v/vt/vn, found '{corner}'");
            return Err(MeshError::malformed(path, Some(line), message));
        }
        self.has_uvs |= uv > 1;
        self.has_normals |= normal > 1;
        write!(self.text, " {position}/{uv}/{normal}").expect("writing to a String succeeds");
        Ok(())
    }

    /// Gives the text to `tobj`: triangles with one index a vertex.
    pub(super) fn parse(
        &self,
        path: &Path,
        materials: impl Fn(&Path) -> tobj::MTLLoadResult,
    ) -> Result<(Vec<tobj::Model>, Vec<tobj::Material>), MeshError> {
        let options = tobj::LoadOptions {
            single_index: true,
            triangulate: true,
            ignore_points: true,
            ignore_lines: true,
        };
        let refuse = |error: tobj::LoadError| MeshError::malformed(path, None, error.to_string());
        let (models, materials) =
            tobj::load_obj_buf(&mut self.text.as_bytes(), &options, materials).map_err(refuse)?;
        Ok((models, materials.map_err(refuse)?))
    }

    /// The material libraries that the file names, as [`Regular::parse`] asks for them.
    pub(super) fn libraries(&self) -> impl Iterator<Item = &str> {
        self.text.lines().filter_map(|line| line.strip_prefix("mtllib ")).map(str::trim)
    }

    /// What was passed over.
    pub(super) fn warnings(&self, path: &Path) -> Vec<String> {
        let unknown = self.unknown.iter().map(|(word, count)| {
            format!("{}: {count} statements '{word}' have no effect", path.display())
        });
        let flat = (self.flat_faces > 0).then(|| {
            format!(
                "{}: {} faces have fewer than three vertices; left out",
                path.display(),
                self.flat_faces
            )
        });
        unknown.chain(flat).collect()
    }
}

/// Lines with their number; a backslash at the end of a line continues it on the next.
fn logical_lines(text: &str) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let mut lines = text.lines().zip(1..);
    std::iter::from_fn(move || {
        let (line, number) = lines.next()?;
        let Some(beginning) = line.strip_suffix('\\') else { return Some((number, line.into())) };
        let mut whole = beginning.to_owned();
        for (line, _) in lines.by_ref() {
            whole.push(' ');
            match line.strip_suffix('\\') {
                Some(beginning) => whole += beginning,
                None => {
                    whole += line;
                    break;
                }
            }
        }
        Some((number, whole.into()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::io::Write as _;

    fn parse(text: &str) -> Result<RawMesh, MeshError> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        load(file.path(), true)
    }

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn negative_indices_count_from_the_last_vertex() {
        let mesh = parse(&format!("{SQUARE}f -4 -3 -2 -1\nv 5 5 5\nf -1 -5 -4\n")).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 0, 1]]);
        assert_eq!(mesh.positions[4], DVec3::splat(5.0));
        assert!(mesh.normals.is_empty() && mesh.uvs.is_empty());
    }

    #[test]
    fn texture_coordinates_are_flipped_and_missing_ones_are_zero() {
        let text = format!("{SQUARE}vt 0.25 0.25\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1//1 3 4/1\n");
        let mesh = parse(&text).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(mesh.uvs[0], Vec2::new(0.25, 0.75));
        // "1 − 0" for a coordinate that is not there.
        assert_eq!(mesh.uvs[4], Vec2::new(0.0, 1.0));
        assert_eq!(mesh.normals[3], Vec3::Z);
        assert_eq!(mesh.normals[4], Vec3::ZERO);
    }

    #[test]
    fn groups_and_materials_do_not_split_a_mesh() {
        let text =
            format!("mtllib none.mtl\n{SQUARE}o a\nusemtl x\nf 1 2 3\ng b\nusemtl y\nf 1 3 4\n");
        let mesh = parse(&text).unwrap();
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn continued_lines_comments_and_odd_statements() {
        let text = format!("# café\n{SQUARE}f 1 2 \\\n 3 4 # four\ncurv 1 2\nl 1 2\nf 1 2\n");
        // A comment may not follow on the same line in OBJ: its words are corners.
        assert!(parse(&text).unwrap_err().to_string().contains("'#'"));
        let mesh = parse(&text.replace(" # four", "")).unwrap();
        assert_eq!(mesh.triangles.len(), 2);
        let warnings = mesh.warnings.join("\n");
        for expected in ["1 statements 'curv'", "1 statements 'l'", "1 faces"] {
            assert!(warnings.contains(expected), "{warnings}");
        }
    }

    #[test]
    fn errors_name_the_line() {
        let message = |lines: &str| parse(&format!("{SQUARE}{lines}\n")).unwrap_err().to_string();
        for (lines, line, expected) in [
            ("f 1 2 5", 5, "vertex index 5 is out of range: there are 4"),
            ("f 1 2 0", 5, "vertex index 0"),
            ("\nf 1 2 -5", 6, "vertex index -5"),
            ("f 1/1 2/1 3/1", 5, "texture coordinate index 1 is out of range: there are 0"),
            ("f 1//9223372036854775807 2 3", 5, "normal index 9223372036854775807"),
            ("f 1//-9223372036854775808 2 3", 5, "normal index"),
            ("f 1/2/3/4 2 3", 5, "expected v/vt/vn"),
            ("f a b c", 5, "found 'a'"),
            ("v 1 2", 5, "'v' expects 3 numbers"),
            ("vn 1 x 2", 5, "found 'x'"),
        ] {
            let message = message(lines);
            assert!(
                message.contains(&format!(":{line}: ")) && message.contains(expected),
                "{message}"
            );
        }
        assert!(message("").contains("no faces"));
        assert!(load(Path::new("/none.obj"), true).unwrap_err().to_string().contains("/none.obj"));
    }

    #[test]
    fn a_truncated_file_never_panics() {
        let text =
            format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -1//-1 -2//-1 -3//-1\n");
        for length in 0..text.len() {
            if let Ok(mesh) = parse(&text[..length]) {
                let count = mesh.positions.len();
                assert!(mesh.triangles.iter().flatten().all(|&index| (index as usize) < count));
            }
        }
    }

    #[test]
    fn nan_vertices_are_counted() {
        let mesh = parse("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert!(mesh.warnings[0].contains("1 vertices are not finite"));
    }
}
