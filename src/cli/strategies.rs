//! `--strategies`: what each strategy of bidirectional path tracing finds, one file each, and all on one sheet.

use super::letters;
use super::{BadInput, Failure};
use crate::dataset::{contact_sheet, exposure};
use crate::integrator::Integrator;
use crate::integrator::bdpt::Bdpt;
use crate::render::{RenderSettings, StrategyImage, strategies, strategy_images};
use crate::scene::Scene;
use anyhow::Context;
use ndarray::s;
use quietlight_denoise::exr::{self, Frame, WriteOptions};
use quietlight_denoise::{Image, Layers, png};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Edges of the longest paths shown: beyond, strategies look alike and a sheet has no room.
const LONGEST: u32 = 6;

/// Side of the square that each picture gets on the sheet, in pixels, and what is left free around it.
const SIDE: usize = 128;
const MARGIN: usize = 4;

/// Height of the two lines of text under each picture.
const TEXT: usize = 2 * letters::HEIGHT + MARGIN;

/// Where the images of strategies go.
#[derive(Debug)]
pub(super) struct Pyramid {
    folder: PathBuf,
    bdpt: Bdpt,
}

impl Pyramid {
    /// Makes the folder asked for, before hours are spent on what goes there; only bidirectional path tracing has
    /// strategies.
    pub(super) fn prepare(
        folder: Option<&Path>,
        settings: &RenderSettings,
    ) -> Result<Option<Self>, Failure> {
        let Some(folder) = folder else { return Ok(None) };
        let Integrator::Bdpt(bdpt) = settings.integrator else {
            return Err(anyhow::anyhow!(
                "only bidirectional path tracing has strategies: --integrator bdpt"
            ))
            .bad_input();
        };
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))
            .bad_input()?;
        Ok(Some(Self { folder: folder.to_path_buf(), bdpt }))
    }

    /// Writes an EXR with and one without weights for each strategy, from the samples of the render, and the two sheets.
    pub(super) fn write(
        &self,
        scene: &Scene,
        settings: &RenderSettings,
        samples: u32,
        frame: Frame,
    ) -> Result<(), Failure> {
        let longest = scene.limits.max_depth.unwrap_or(LONGEST).min(LONGEST);
        let wanted = strategies(scene, &self.bdpt, longest);
        let mut entries = Vec::with_capacity(wanted.len());
        strategy_images(scene, &self.bdpt, settings, samples, &wanted, |image| {
            for (kind, picture) in
                [("unweighted", &image.unweighted), ("weighted", &image.weighted)]
            {
                let path = self.folder.join(file_name(kind, &image));
                self.write_exr(&path, picture, &image, samples, frame)?;
            }
            entries.push(Entry::of(&image));
            Ok::<_, Failure>(())
        })?;
        for kind in [Kind::Unweighted, Kind::Weighted] {
            let path = self.folder.join(format!("{}.png", kind.name()));
            png::write(&path, &sheet(&entries, kind), 0.0)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    fn write_exr(
        &self,
        path: &Path,
        picture: &Image,
        image: &StrategyImage,
        samples: u32,
        frame: Frame,
    ) -> Result<(), Failure> {
        let (_, height, width) = picture.dim();
        let facts = [
            ("s", image.s.to_string()),
            ("t", image.t.to_string()),
            ("samples", samples.to_string()),
            ("dropped", image.dropped.to_string()),
            ("integrator_settings", format!("{:?}", self.bdpt)),
        ];
        let metadata: BTreeMap<_, _> =
            facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let layers = Layers { width, height, metadata, ..Layers::default() };
        let options =
            WriteOptions { picture: Some(picture), frame: Some(frame), ..WriteOptions::default() };
        exr::write(path, &layers, &options)
            .with_context(|| format!("cannot write {}", path.display()))
            .map_err(Failure::Failed)
    }
}

fn file_name(kind: &str, image: &StrategyImage) -> String {
    format!("{kind}-k{}-s{}-t{}.exr", image.s + image.t - 1, image.s, image.t)
}

/// Which of the two images of a strategy.
#[derive(Clone, Copy)]
enum Kind {
    Unweighted,
    Weighted,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Unweighted => "unweighted",
            Self::Weighted => "weighted",
        }
    }
}

/// A strategy on a sheet.
struct Entry {
    s: u32,
    t: u32,
    /// Without and with weights: the image in small, and the mean of all its numbers.
    pictures: [(Image, f64); 2],
}

impl Entry {
    fn of(image: &StrategyImage) -> Self {
        let pictures = [&image.unweighted, &image.weighted].map(|picture| {
            let sum: f64 = picture.iter().map(|&value| f64::from(value)).sum();
            (contact_sheet::shrunk(picture, SIDE), sum / picture.len().max(1) as f64)
        });
        Self { s: image.s, t: image.t, pictures }
    }

    fn k(&self) -> u32 {
        self.s + self.t - 1
    }
}

/// A row for each length of path, each centred, by vertices from the light. All pictures of a row, on both sheets, are as
/// bright as the sum of its weighted ones wants.
fn sheet(entries: &[Entry], kind: Kind) -> Image {
    let mut rows: BTreeMap<u32, Vec<&Entry>> = BTreeMap::new();
    for entry in entries {
        rows.entry(entry.k()).or_default().push(entry);
    }
    let (_, height, width) = entries.first().map_or((3, 0, 0), |entry| entry.pictures[0].0.dim());
    let cell = (height + TEXT + MARGIN, width.max(8 * letters::WIDTH) + MARGIN);
    let columns = rows.values().map(Vec::len).max().unwrap_or(0);
    let mut sheet =
        Image::from_elem((3, rows.len() * cell.0 + MARGIN, columns * cell.1 + MARGIN), 0.03);
    for (row, entries) in rows.values().enumerate() {
        let mut whole = Image::zeros((3, height, width));
        entries.iter().for_each(|entry| whole += &entry.pictures[1].0);
        let gain = exposure::gain(&whole) as f32;
        let indent = (columns - entries.len()) * cell.1 / 2;
        for (column, entry) in entries.iter().enumerate() {
            let (small, mean) = &entry.pictures[kind as usize];
            let (top, left) = (MARGIN + row * cell.0, MARGIN + indent + column * cell.1);
            sheet
                .slice_mut(s![.., top..top + height, left..left + width])
                .assign(&small.mapv(|light| contact_sheet::tone_map(light * gain)));
            let names = format!("k{} s{} t{}", entry.k(), entry.s, entry.t);
            for (line, text) in [names, format!("{mean:.2e}")].iter().enumerate() {
                let below = top + height + MARGIN / 2 + line * letters::HEIGHT;
                letters::draw(&mut sheet, text, below, left);
            }
        }
    }
    sheet
}
