//! Mitsuba scene files: version 3 of the format, with the spellings of 0.5 to 2 upgraded.
//!
//! Reading goes in two steps. [`read`] turns text into a [`document`]: plugins with properties, parameters substituted,
//! includes and references resolved, and the place of everything kept. Then each kind of plugin is asked for what it
//! means, by the file named after it; what nobody asks for is an error, as in Mitsuba, so that nothing is passed over
//! in silence. Definitions that no shape uses are not asked at all.
//!
//! Deliberately absent: participating media, spectra, motion, instances, hair.

mod document;
mod parameters;
mod properties;
mod read;
mod sensor;
mod shapes;
mod transform;
mod upgrade;
mod value;
