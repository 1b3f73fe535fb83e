use super::*;
use crate::geometry::Interaction;
use glam::Vec3;

fn parse(text: &str) -> Result<Vec<tobj::Material>, MeshError> {
    let text = regular(Path::new("a.mtl"), text, &mut Vec::new())?;
    Ok(tobj::load_mtl_buf(&mut text.as_bytes()).unwrap().0)
}

fn make(text: &str) -> (Material, Option<Texture>) {
    let library = parse(&format!("newmtl a\n{text}\n")).unwrap();
    material(&library[0], Path::new(""), &mut ImageCache::default()).unwrap()
}

fn at() -> Interaction {
    Interaction {
        normal: Vec3::Z,
        shading_normal: Vec3::Z,
        dp_du: Vec3::X,
        dp_dv: Vec3::Y,
        ..Interaction::default()
    }
}

#[test]
fn statements_become_models() {
    use crate::bsdf::Bsdf;
    let is = |text: &str, test: fn(&Bsdf<'_>) -> bool| {
        let (material, _) = make(text);
        assert!(test(&material.bsdf(&at())), "{text}: {material:?}");
    };
    is(
        "Kd 0.1 0.2 0.3",
        |bsdf| matches!(bsdf, Bsdf::Diffuse(model) if model.reflectance == Rgb::new(0.1, 0.2, 0.3)),
    );
    is("Kd 0.5 0.5 0.5\nKs 0 0 0\nNs 10", |bsdf| matches!(bsdf, Bsdf::Diffuse(_)));
    is("Kd 0.5 0.5 0.5\nKs 1 1 1\nNs 10\nillum 1", |bsdf| matches!(bsdf, Bsdf::Diffuse(_)));
    is("Kd 0.5 0.5 0.5\nKs 1 1 1\nNs 10", |bsdf| matches!(bsdf, Bsdf::RoughPlastic(_)));
    is("Kd 0.5 0.5 0.5\nKs 1 1 1\nillum 3", |bsdf| matches!(bsdf, Bsdf::Plastic(_)));
    is("Kd 0 0 0\nKs 0.9 0.8 0.1\nNs 100", |bsdf| matches!(bsdf, Bsdf::RoughConductor(_)));
    is("Kd 0\nKs 0.9 0.8 0.1\nillum 5", |bsdf| bsdf.albedo() == Rgb::new(0.9, 0.8, 0.1));
    is(
        "Kd 0 0 0\nNi 1.33\nillum 7\nTf 1 0.5 1",
        |bsdf| matches!(bsdf, Bsdf::Dielectric(model) if model.glass.eta == 1.33 && model.glass.transmittance.g == 0.5),
    );
}

#[test]
fn transparency_emission_and_sides() {
    let (material, radiance) = make("Kd 0.2 0.2 0.2\nTr 0.25\nKe 2 1 0");
    assert_eq!(material.opacity(&at()), 0.75);
    assert!(material.two_sided);
    assert_eq!(radiance.unwrap().mean(), Rgb::new(2.0, 1.0, 0.0));
    let (material, radiance) = make("d -halo 1\nKe 0 0 0\nillum 6");
    assert!(material.is_opaque() && !material.two_sided && radiance.is_none());
}

#[test]
fn broken_statements_name_their_line() {
    for (line, expected) in [
        ("Kd 0.5 0.5", "three"),
        ("Kd spectral red.rfl", "three"),
        ("Ks -1 0 0", "none negative"),
        ("Ke nan nan nan", "three"),
        ("Ns", "a number"),
        ("illum 12", "0 to 10"),
        ("map_Kd", "a name"),
        ("newmtl", "a name"),
    ] {
        let message = parse(&format!("newmtl a\n{line}\n")).unwrap_err().to_string();
        assert!(message.starts_with("a.mtl:2: ") && message.contains(expected), "{message}");
    }
    assert_eq!(parse("newmtl a\nKd 0.5\nKs 0.1 0.2 0.3 # red\n").unwrap().len(), 1);
    let mut warnings = Vec::new();
    regular(Path::new("a.mtl"), "Pr 0.5\nKa 1 1 1\nPr 1\n", &mut warnings).unwrap();
    assert_eq!(warnings, ["a.mtl: 2 statements 'Pr' have no effect"]);
}

#[test]
fn texture_options_end_where_the_name_begins() {
    let map = Map::parse("-s 2 3 1 -o 0.5 -clamp on -bm 0.2 my wood.png");
    assert_eq!(map.file, "my wood.png");
    assert_eq!((map.scale, map.offset), (Vec2::new(2.0, 3.0), Vec2::new(0.5, 0.0)));
    assert_eq!((map.wrap, map.bump), (Wrap::Clamp, 0.2));
    assert_eq!(Map::parse("plain.png").file, "plain.png");
    assert_eq!(Map::parse("-odd.png").file, "-odd.png");
    assert_eq!(Map::parse("-s").file, "");
}

#[test]
fn a_scaled_map_counts_v_upwards() {
    let folder = tempfile::tempdir().unwrap();
    let pixels = vec![255, 255, 255, 0, 0, 0];
    image::RgbImage::from_raw(1, 2, pixels).unwrap().save(folder.path().join("a.png")).unwrap();
    let texture = |text: &str| {
        Map::parse(text).texture(folder.path(), true, &mut ImageCache::default()).unwrap()
    };
    // In file coordinates v = 0.75 is the white upper half; the reader has turned it to 0.25.
    assert_eq!(texture("a.png").eval(Vec2::new(0.5, 0.25)), Rgb::WHITE);
    // Moved up by half an image: the black lower half.
    assert_eq!(texture("-o 0 0.5 a.png").eval(Vec2::new(0.5, 0.25)), Rgb::BLACK);
    // v = 0.375 of a doubled image is 0.75 of it.
    assert_eq!(texture("-s 1 2 a.png").eval(Vec2::new(0.5, 1.0 - 0.375)), Rgb::WHITE);
}
