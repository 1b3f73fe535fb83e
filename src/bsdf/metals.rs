//! Refractive indices of metals.

use crate::math::Rgb;

/// Names, `η` and `k` for red, green and blue. The indices were measured (luxpop.com; those named `_palik` in Palik 1998,
/// "Handbook of Optical Constants of Solids"), weighted with the CIE 1931 observer and converted to linear Rec. 709 as
/// Mitsuba 3.9.1 does it, from which they were read, so that metals look alike in both. Substances whose index has a
/// component outside the gamut (mostly transparent ones: `MgO`, `TiO2`, ...) are not metals and left out.
const METALS: [(&str, [f32; 3], [f32; 3]); 32] = [
    // A perfect mirror: no angle and no colour loses light.
    ("none", [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ("a-C", [2.94405, 2.22714, 1.96816], [0.88746, 0.79930, 0.81529]),
    ("Ag", [0.15528, 0.11673, 0.13839], [4.82835, 3.12222, 2.14690]),
    ("Al", [1.65750, 0.88040, 0.52124], [9.22381, 6.26950, 4.83700]),
    ("Au", [0.14304, 0.37531, 1.44205], [3.98300, 2.38556, 1.60336]),
    ("Be", [4.18501, 3.18503, 2.78406], [3.83547, 3.01012, 2.86899]),
    ("Cr", [4.36967, 2.91651, 1.65490], [5.20655, 4.23131, 3.75470]),
    ("Cu", [0.20101, 0.92375, 1.10222], [3.91326, 2.45305, 2.14209]),
    ("Cu2O", [3.55177, 2.94987, 2.75188], [0.11421, 0.19390, 0.60613]),
    ("Cu_palik", [0.21323, 0.91972, 1.10241], [3.92187, 2.45733, 2.13658]),
    ("CuO", [3.24754, 2.44781, 2.21022], [0.52109, 0.57003, 0.72218]),
    ("Hg", [2.39894, 1.44003, 0.90957], [6.32759, 4.37192, 3.42176]),
    ("HgTe", [4.77904, 3.23120, 2.65990], [1.63161, 1.58081, 1.72929]),
    ("Ir", [3.08630, 2.08219, 1.61791], [5.59215, 4.06709, 3.26731]),
    ("K", [0.06404, 0.04641, 0.03818], [2.10420, 1.34894, 0.91313]),
    ("Li", [0.26579, 0.19562, 0.22095], [3.54015, 2.31112, 1.66861]),
    ("Mo", [4.48397, 3.52513, 2.77631], [4.11144, 3.42083, 3.15061]),
    ("Na_palik", [0.06027, 0.05614, 0.06199], [3.17927, 2.11249, 1.57904]),
    ("Nb", [3.42007, 2.79009, 2.39563], [3.44139, 2.73767, 2.57975]),
    ("Ni_palik", [2.36730, 1.66337, 1.46708], [4.49881, 3.05015, 2.34544]),
    ("Rh", [2.58579, 1.86022, 1.55426], [6.78226, 4.70299, 3.97607]),
    ("Se", [4.05831, 2.84294, 2.82085], [0.75405, 0.63844, 0.52181]),
    ("Se-e", [5.72285, 4.16574, 4.08134], [0.87114, 1.10516, 1.56532]),
    ("Ta", [2.06272, 2.39294, 2.62793], [2.40836, 1.74149, 1.94703]),
    ("Te", [7.39023, 4.48210, 2.63711], [3.25602, 3.52706, 3.29205]),
    ("Te-e", [7.50891, 4.29643, 2.36999], [5.58393, 4.94721, 3.99759]),
    ("TiC", [3.70053, 2.83742, 2.58229], [3.26564, 2.35159, 2.17279]),
    ("TiN", [1.64845, 1.15052, 1.37982], [3.36833, 1.94350, 1.10207]),
    ("V_palik", [4.27758, 3.51295, 2.76107], [3.49130, 2.88945, 3.11152]),
    ("VC", [3.65757, 2.75274, 2.53267], [3.06830, 2.19869, 1.96319]),
    ("VN", [2.86560, 2.11919, 1.94009], [3.03224, 2.05612, 1.61631]),
    ("W", [4.37082, 3.30025, 2.99841], [3.50064, 2.60487, 2.27323]),
];

/// The complex index `(η, k)` of a metal by its name in Mitsuba ("Au", "Cu", "none", ...; see [`names`]); the ending
/// `_palik` may be added or left out.
pub fn complex_index(name: &str) -> Option<(Rgb, Rgb)> {
    let find = |wanted: &str| METALS.iter().find(|(known, ..)| *known == wanted);
    find(name)
        .or_else(|| find(name.strip_suffix("_palik")?))
        .or_else(|| find(&format!("{name}_palik")))
        .map(|&(_, eta, k)| (Rgb::from(eta), Rgb::from(k)))
}

/// All known names.
pub fn names() -> impl Iterator<Item = &'static str> {
    METALS.iter().map(|&(name, ..)| name)
}

#[cfg(test)]
mod tests {
    use super::super::fresnel::conductor;
    use super::*;

    #[test]
    fn metals_have_their_colours() {
        let colour = |name: &str| {
            let (eta, k) = complex_index(name).unwrap();
            conductor(1.0, eta, k)
        };
        let gold = colour("Au");
        assert!(gold.r > 0.9 && gold.g < gold.r && gold.b < 0.6 * gold.r);
        let copper = colour("Cu");
        assert!(copper.r > copper.g && copper.g > copper.b);
        assert!(colour("Ag").b > 0.9 && colour("Al").g > 0.9);
        assert_eq!(colour("none"), Rgb::WHITE);
        assert_eq!(complex_index("Au_palik"), complex_index("Au"));
        assert!(complex_index("Ni").is_some() && complex_index("unobtainium").is_none());
        assert!(names().all(|name| complex_index(name).is_some()));
    }
}
