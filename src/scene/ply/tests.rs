use super::*;
use std::io::Write;

fn temporary(content: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(content).unwrap();
    file
}

fn parse(content: &[u8]) -> Result<RawMesh, MeshError> {
    load(temporary(content).path(), false)
}

/// A unit square as one quad and a pentagon-free triangle, with normals and texture coordinates.
fn header(format: &str, index: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment a square\nelement vertex 4\nproperty float x\nproperty double y\n\
             property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty float s\n\
             property float t\nproperty uchar red\nelement face 2\nproperty list uchar {index} vertex_indices\n\
             end_header\n"
    )
}

const SQUARE: [[f32; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

fn ascii() -> Vec<u8> {
    let mut text = header("ascii", "int");
    for [x, y] in SQUARE {
        text += &format!("{x} {y} 0 0 0 1 {x} {y} 255\n");
    }
    text += "4 0 1 2 3\n3 0 2 3\n";
    text.into_bytes()
}

fn binary(little: bool) -> Vec<u8> {
    let mut bytes =
        header(if little { "binary_little_endian" } else { "binary_big_endian" }, "ushort")
            .into_bytes();
    let mut put = |little_bytes: &[u8]| {
        if little {
            bytes.extend(little_bytes);
        } else {
            bytes.extend(little_bytes.iter().rev());
        }
    };
    for [x, y] in SQUARE {
        put(&x.to_le_bytes());
        put(&f64::from(y).to_le_bytes());
        for value in [0.0, 0.0, 0.0, 1.0, x, y] {
            put(&value.to_le_bytes());
        }
        put(&[255]);
    }
    for face in [&[0u16, 1, 2, 3][..], &[0, 2, 3]] {
        put(&[face.len() as u8]);
        for index in face {
            put(&index.to_le_bytes());
        }
    }
    bytes
}

#[test]
fn all_encodings_give_the_same_mesh() {
    let mesh = parse(&ascii()).unwrap();
    assert_eq!(mesh.positions[2], DVec3::new(1.0, 1.0, 0.0));
    assert_eq!(mesh.normals, [Vec3::Z; 4]);
    assert_eq!(mesh.uvs, SQUARE.map(Vec2::from));
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
    assert_eq!(parse(&binary(true)).unwrap(), mesh);
    assert_eq!(parse(&binary(false)).unwrap(), mesh);
    let flipped = load(temporary(&ascii()).path(), true).unwrap();
    assert_eq!(flipped.uvs[1], Vec2::new(1.0, 1.0));
}

#[test]
fn a_truncated_file_is_an_error_at_every_length() {
    for bytes in [ascii(), binary(true), binary(false)] {
        // The last newline of the ascii file may be missing.
        for length in 0..bytes.len() - 1 {
            let error = parse(&bytes[..length]);
            // A number cut in half is still a number: the last line of ascii files may lose digits unnoticed,
            // but "3 0 2 3" has single digits only.
            assert!(error.is_err(), "{length} of {} bytes gave {error:?}", bytes.len());
        }
    }
}

#[test]
fn damaged_bytes_never_panic() {
    for original in [ascii(), binary(true)] {
        for position in 0..original.len() {
            for value in [0u8, b'9', 0x7f, 0xff] {
                let mut bytes = original.clone();
                bytes[position] = value;
                if let Ok(mesh) = parse(&bytes) {
                    let count = mesh.positions.len();
                    assert!(mesh.triangles.iter().flatten().all(|&index| (index as usize) < count));
                }
            }
        }
    }
}

#[test]
fn errors_say_what_is_wrong() {
    let message = |content: &str| parse(content.as_bytes()).unwrap_err().to_string();
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    let face = "element face 1\nproperty list uchar int vertex_index\n";
    let begin = "ply\nformat ascii 1.0\n";

    assert!(message("solid cube").contains("not a valid PLY"));
    assert!(message("").contains("not a valid PLY"));
    assert!(message(&format!("{begin}{vertex}end_header\n0 0 0\n")).contains("'face'"));
    assert!(message(&format!("{begin}element vertex 0\n{face}end_header\n")).contains("'x'"));
    let wrong = format!("{begin}{vertex}{face}end_header\n0 0 0\n3 0 0 7\n");
    assert!(message(&wrong).contains("[0, 0, 7]") && message(&wrong).contains("1 vertices"));
    let wrong = format!("{begin}{vertex}{face}end_header\n0 0 0\n3 0 0 -1\n");
    assert!(message(&wrong).contains("[0, 0, -1]"));
    let wrong = format!("{begin}{vertex}{face}end_header\n0 zero 0\n3 0 0 0\n");
    assert!(message(&wrong).contains(":10: "), "{}", message(&wrong));
    let huge =
        format!("{begin}{}{face}end_header\n0 0 0\n3 0 0 0\n", vertex.replace('1', "99999999999"));
    assert!(message(&huge).contains("truncated"));
    let missing = load(Path::new("/nonexistent/mesh.ply"), false).unwrap_err();
    assert!(missing.to_string().contains("/nonexistent/mesh.ply"));
}

#[test]
fn odd_vertices_are_counted() {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
            property float z\nproperty float u\nproperty float v\nelement face 2\n\
            property list uchar uchar vertex_indices\nelement edge 1\nproperty uchar a\nend_header\n"
            .to_vec();
    let (nan, infinite) = (f32::NAN, f32::INFINITY);
    let vertices = [nan, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, nan, 1.0, 0.0, infinite, 0.0, 1.0, 1.0];
    bytes.extend(vertices.iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend([3, 0, 1, 2, 2, 0, 1, 5]);
    let mesh = parse(&bytes).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.uvs[1], Vec2::ZERO);
    let warnings = mesh.warnings.join("\n");
    for expected in ["2 vertices are not finite", "1 texture coordinates", "1 faces", "'edge'"] {
        assert!(warnings.contains(expected), "{expected}: {warnings}");
    }
    // The parser knows no such words in ascii files: an error with its line.
    let text = String::from_utf8(ascii()).unwrap().replace("1 1 0", "nan 1 0");
    let message = parse(text.as_bytes()).unwrap_err().to_string();
    assert!(message.contains(":18: ") && message.contains("nan 1 0"), "{message}");
}
