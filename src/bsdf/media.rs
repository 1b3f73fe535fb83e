//! Refractive indices of transparent media.

/// Names and indices at 589 nm and room temperature (Hecht, "Optics", 4th edition, and common tables; the list of names is
/// that of Mitsuba 3).
const MEDIA: [(&str, f32); 23] = [
    ("vacuum", 1.0),
    ("helium", 1.000_036),
    ("hydrogen", 1.000_132),
    ("air", 1.000_277),
    ("carbon dioxide", 1.000_45),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.472_9),
    ("benzene", 1.501),
    ("silicone oil", 1.520_45),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.504_6),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
];

/// The refractive index of a medium by its name, upper or lower case.
pub fn index(name: &str) -> Option<f32> {
    MEDIA.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|&(_, index)| index)
}

/// All known names.
pub fn names() -> impl Iterator<Item = &'static str> {
    MEDIA.iter().map(|&(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn media_are_found_by_name() {
        assert_eq!(index("BK7"), Some(1.504_6));
        assert_eq!(index("ether"), None);
        assert!(names().all(|name| index(name).is_some_and(|n| n >= 1.0)));
    }
}
