//! Making the views of a data set: which are missing, whether they fit, and who renders them.

use super::manifest::{Manifest, Record, Settings, View, records};
use super::{Error, Shard, pairs, space};
use crate::folder::{self, at};
use std::collections::HashSet;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Which views of which data set to make.
#[derive(Clone, Debug)]
pub struct Job {
    /// Folder of the data set; made if it is not there.
    pub folder: PathBuf,
    /// What decides the pictures.
    pub settings: Settings,
    /// How many views the set is to have.
    pub views: u32,
    /// Which of them this process makes.
    pub shard: Shard,
    /// Threads; at least 1.
    pub threads: usize,
    /// Are generated scenes kept, in `scenes/ID`?
    pub keep_scenes: bool,
}

/// What there is to do, and what it takes.
#[derive(Debug)]
pub struct Plan {
    job: Job,
    manifest: Manifest,
    /// Numbers of the views to make.
    missing: Vec<u32>,
    /// Views of the shard that are there already.
    pub complete: usize,
    /// Bytes that the missing views will take, about.
    pub needed: u64,
    /// Bytes free on the disk; `None` where the system does not say.
    pub free: Option<u64>,
}

/// What was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Views rendered.
    pub rendered: usize,
    /// Views whose scene failed, which is noted in their `skipped.json`.
    pub skipped: usize,
    /// Was the work stopped before all views were made?
    pub is_interrupted: bool,
}

impl Job {
    /// Compares with what is in the folder and on the disk; changes nothing.
    ///
    /// # Errors
    /// [`folder::Error::Settings`] where the folder has a set of other settings, [`Error::Space`] where the disk is too small.
    pub fn plan(self) -> Result<Plan, Error> {
        let mut manifest = Manifest::new(self.settings.clone(), self.views);
        let mut existing = Vec::new();
        if Manifest::path(&self.folder).exists() {
            let found = Manifest::read(&self.folder)?;
            let differences = self.settings.differences(&found.settings);
            if !differences.is_empty() {
                return Err(folder::Error::Settings {
                    path: Manifest::path(&self.folder),
                    differences,
                }
                .into());
            }
            manifest.views = manifest.views.max(found.views);
            if self.folder.join("views").exists() {
                existing = records(&self.folder)?;
            }
        }
        let done: HashSet<&str> =
            existing.iter().map(|record| record.identity().id.as_str()).collect();
        let is_complete = |number: &u32| done.contains(View::id(*number).as_str());
        let (complete, missing): (Vec<u32>, Vec<u32>) =
            self.shard.views(self.views).partition(is_complete);
        // What some views took says better than the settings what others will take.
        let measured: Vec<u64> =
            existing.iter().map(|view| space::view(&self.folder, &view.identity().id)).collect();
        let each = if measured.len() < 8 {
            space::expected_view(&self.settings)
        } else {
            measured.iter().sum::<u64>() / measured.len() as u64
        };
        let needed = each * missing.len() as u64;
        let standing = self.folder.ancestors().find(|folder| folder.is_dir());
        let free = space::free(standing.unwrap_or(".".as_ref()));
        if let Some(free) = free
            && needed > free
        {
            return Err(Error::Space { path: self.folder, needed, free });
        }
        Ok(Plan { job: self, manifest, missing, complete: complete.len(), needed, free })
    }
}

impl Plan {
    /// How many views are to be made.
    pub fn len(&self) -> usize {
        self.missing.len()
    }

    /// Is there nothing to do?
    pub fn is_empty(&self) -> bool {
        self.missing.is_empty()
    }

    /// Makes the missing views. Views are small: as long as there are enough of them each thread makes its own from
    /// beginning to end, so that nobody waits for anybody.
    ///
    /// `progress` is called from the workers with the number of views made so far. When `stop` becomes true the views
    /// under way are dropped.
    ///
    /// # Errors
    /// Where files cannot be written; views made until then stay.
    pub fn run(
        &self,
        progress: &(dyn Fn(u64) + Sync),
        stop: &AtomicBool,
    ) -> Result<Outcome, Error> {
        let folder = &self.job.folder;
        fs::create_dir_all(folder.join("views")).map_err(at(folder))?;
        self.manifest.write(folder)?;
        let threads = self.job.threads.max(1);
        let workers = threads.min(self.missing.len());
        let pools = (0..workers)
            .map(|worker| {
                let share = threads / workers + usize::from(worker < threads % workers);
                rayon::ThreadPoolBuilder::new().num_threads(share).build()
            })
            .collect::<Result<Vec<_>, _>>()?;

        let next = AtomicUsize::new(0);
        let state = Mutex::new((Outcome::default(), None));
        let has_failed = AtomicBool::new(false);
        let work = || {
            while !stop.load(Ordering::Relaxed) && !has_failed.load(Ordering::Relaxed) {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(&number) = self.missing.get(index) else { return };
                let made = pairs::make_view(&self.job, number, stop);
                let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
                let (outcome, failure) = &mut *state;
                match made {
                    Ok(Some(Record::Rendered(_))) => outcome.rendered += 1,
                    Ok(Some(Record::Skipped(_))) => outcome.skipped += 1,
                    Ok(None) => return,
                    Err(error) => {
                        has_failed.store(true, Ordering::Relaxed);
                        failure.get_or_insert(error);
                        return;
                    }
                }
                progress((outcome.rendered + outcome.skipped) as u64);
            }
        };
        std::thread::scope(|scope| {
            for pool in &pools {
                scope.spawn(|| pool.install(work));
            }
        });
        let (outcome, failure) = state.into_inner().unwrap_or_else(PoisonError::into_inner);
        match failure {
            Some(error) => Err(error),
            None => {
                let made = outcome.rendered + outcome.skipped;
                Ok(Outcome { is_interrupted: made < self.missing.len(), ..outcome })
            }
        }
    }
}
