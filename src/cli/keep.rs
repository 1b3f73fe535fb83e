//! Long renders survive: checkpoints, going on, and the parts that several machines make.

use super::args::Render;
use super::render::STOP;
use super::{BadInput, Failure};
use crate::render::{Budget, Header, RenderSettings, Rendering, Shard, State};
use crate::scene::Scene;
use anyhow::{Context, anyhow};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

/// How often Ctrl-C and the time of the next checkpoint are looked at.
const TICK: Duration = Duration::from_millis(20);

/// Keeps what a render has found where a later run finds it again.
pub(super) struct Keeper {
    every: Option<Duration>,
    is_resumed: bool,
    is_json: bool,
    shard: Shard,
    /// What a render under way is kept in.
    checkpoint: PathBuf,
    /// What a shard is written to when it is done.
    part: PathBuf,
    notes: BTreeMap<String, String>,
}

impl Keeper {
    /// Of a render to `output`; `notes` go into every file that is kept.
    pub(super) fn new(arguments: &Render, output: &Path, notes: BTreeMap<String, String>) -> Self {
        let shard = arguments.shard;
        let of_shard = match shard.count() {
            1 => String::new(),
            count => format!("{}-of-{count}.", shard.index()),
        };
        Self {
            every: arguments.checkpoint.0,
            is_resumed: arguments.resume,
            is_json: arguments.finish.json,
            shard,
            checkpoint: output.with_extension(format!("{of_shard}checkpoint")),
            part: output.with_extension(format!("{of_shard}shard")),
            notes,
        }
    }

    /// Is only a part of the picture rendered?
    pub(super) fn is_part(&self) -> bool {
        self.shard.count() > 1
    }

    /// What is known of the picture before it is made.
    pub(super) fn notes(&self) -> &BTreeMap<String, String> {
        &self.notes
    }

    /// Has an earlier run written the part already, and is it to be gone on with?
    pub(super) fn is_part_done(
        &self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<bool, Failure> {
        if !(self.is_resumed && self.part.exists()) {
            return Ok(false);
        }
        let header = Header::read(&self.part).bad_input()?;
        header
            .check(scene, settings)
            .with_context(|| self.part.display().to_string())
            .bad_input()?;
        self.tell_part(header.elapsed, "done already");
        Ok(true)
    }

    /// A render without samples, or with those that an earlier run kept.
    pub(super) fn begin<'s>(
        &self,
        scene: &'s Scene,
        settings: &RenderSettings,
        threads: &rayon::ThreadPool,
    ) -> Result<Rendering<'s>, Failure> {
        let checkpoint = self.checkpoint.display();
        if !self.checkpoint.exists() {
            if self.is_resumed {
                eprintln!("{checkpoint} is not there: beginning anew");
            }
            return Ok(Rendering::new(scene, settings));
        }
        if !self.is_resumed {
            eprintln!(
                "warning: {checkpoint} of an earlier render is there, and will be replaced; --resume would go on from it"
            );
            return Ok(Rendering::new(scene, settings));
        }
        let state = State::read(&self.checkpoint).bad_input()?;
        let seconds = state.header.elapsed.as_secs_f64();
        let rendering = threads
            .install(|| Rendering::resume(scene, settings, state))
            .with_context(|| {
                format!("cannot go on from {checkpoint}; without --resume, it begins anew")
            })
            .bad_input()?;
        let samples = rendering.samples();
        eprintln!("going on from {checkpoint}: {samples} samples per pixel in {seconds:.1} s");
        Ok(rendering)
    }

    /// Renders, and keeps what there is from time to time, and at the end of a long render or one that Ctrl-C ends. `show` gets
    /// the progress.
    pub(super) fn run(
        &self,
        rendering: &mut Rendering<'_>,
        budget: Budget,
        threads: &rayon::ThreadPool,
        show: &(dyn Fn(u64) + Sync),
    ) {
        let mut last = Instant::now();
        let mut is_long = self.is_resumed && self.checkpoint.exists();
        loop {
            let is_due = || self.every.is_some_and(|every| last.elapsed() >= every);
            let pause = run_until(rendering, budget, threads, show, &is_due);
            let is_stopped = STOP.load(Ordering::Relaxed);
            let is_done = !pause && !is_stopped;
            is_long |= pause;
            if is_stopped || (is_long && !self.is_part()) || !is_done {
                self.keep(rendering);
            }
            if is_stopped || is_done {
                return;
            }
            last = Instant::now();
        }
    }

    /// Writes the checkpoint. Where that fails, the render goes on without.
    fn keep(&self, rendering: &Rendering<'_>) {
        if self.every.is_none() {
            return;
        }
        match self.write(rendering, &self.checkpoint) {
            Ok(()) if STOP.load(Ordering::Relaxed) => {
                eprintln!("{} is kept: --resume goes on from it", self.checkpoint.display());
            }
            Ok(()) => {}
            Err(error) => eprintln!("warning: no checkpoint could be written: {error}"),
        }
    }

    fn write(&self, rendering: &Rendering<'_>, path: &Path) -> anyhow::Result<()> {
        let mut state = rendering.state();
        state.header.notes.clone_from(&self.notes);
        Ok(state.write(path)?)
    }

    /// Writes a shard that is done.
    ///
    /// # Errors
    /// [`Failure::Interrupted`] where it is not done.
    pub(super) fn finish_part(&self, rendering: &Rendering<'_>) -> Result<(), Failure> {
        if STOP.load(Ordering::Relaxed) {
            return Err(Failure::Interrupted);
        }
        self.write(rendering, &self.part)
            .with_context(|| format!("cannot write {}", self.part.display()))?;
        self.forget();
        self.tell_part(rendering.state().header.elapsed, "done");
        Ok(())
    }

    fn tell_part(&self, elapsed: Duration, how: &str) {
        let (part, seconds) = (self.part.display(), elapsed.as_secs_f64());
        let (index, count) = (self.shard.index(), self.shard.count());
        if self.is_json {
            let json = serde_json::json!({
                "part": self.part,
                "index": index,
                "count": count,
                "render_seconds": seconds,
            });
            println!("{json:#}");
        } else {
            println!(
                "{part}: part {index} of {count} is {how}, in {seconds:.1} s; `quietlight merge` makes the picture of all"
            );
        }
    }

    /// Takes the checkpoint away, once the picture is written.
    pub(super) fn forget(&self) {
        if self.checkpoint.exists()
            && let Err(error) = std::fs::remove_file(&self.checkpoint)
        {
            let error = anyhow!(error);
            eprintln!("warning: {} could not be removed: {error}", self.checkpoint.display());
        }
    }
}

/// Renders until all is done, Ctrl-C, or `is_due`; returns whether the end was due.
fn run_until(
    rendering: &mut Rendering<'_>,
    budget: Budget,
    threads: &rayon::ThreadPool,
    show: &(dyn Fn(u64) + Sync),
    is_due: &(dyn Fn() -> bool + Sync),
) -> bool {
    let pause = AtomicBool::new(false);
    let (ended, wait) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        let pause = &pause;
        scope.spawn(move || {
            while wait.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout) {
                if STOP.load(Ordering::Relaxed) || is_due() {
                    pause.store(true, Ordering::Relaxed);
                }
            }
        });
        // Dropped at the end of the work, also of one that panics.
        let _ended = ended;
        threads.install(|| rendering.run(budget, show, pause));
    });
    pause.load(Ordering::Relaxed)
}
