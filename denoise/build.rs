//! Brings onnxruntime and the weights of the networks into the library.
//!
//! onnxruntime comes from `PyPI` or `npm`, by the name and version of its package, is checked by its SHA-256 and kept in
//! `target/onnxruntime`, which all profiles share. Where it cannot be had the build goes on without, says so, and the
//! next build tries again; the library is then looked for when it is needed. See `src/kpcn/library.rs`.

#![allow(clippy::print_stdout, reason = "this is how a build script talks to cargo")]

use std::env;
use std::error::Error;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

#[path = "src/sha256.rs"]
#[allow(unreachable_pub, reason = "it is public in the library, which has the same file")]
mod sha256;

/// A package that has onnxruntime in it, and where.
struct Package {
    /// What the library is called in `target/onnxruntime`.
    file: &'static str,
    /// Of the library itself.
    sha256: &'static str,
    /// Downloads the package into a folder and gives the path of the unpacked library.
    fetch: fn(&Path) -> Result<PathBuf, Box<dyn Error>>,
}

/// Not 1.29 or newer from `PyPI`: those carry a telemetry client, on by default, that writes into the user's home.
const PACKAGES: [Package; 2] = [
    Package {
        file: "libonnxruntime.so.1.28.0",
        sha256: "aa4079d18f4ea7a5f3a94d80cd4bbe0f2740436626622d64d793803a20381083",
        fetch: fetch_from_pypi,
    },
    Package {
        file: "libonnxruntime.so.1.27.0",
        sha256: "d8aff4aa8abee8fb2abb2f2f2459ffc94461e781e41b9f7c072829dd0d470221",
        fetch: fetch_from_npm,
    },
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/sha256.rs");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut code = String::new();

    let library = match onnxruntime(&target_folder(&out).join("onnxruntime")) {
        Ok(path) => Some(path),
        Err(reason) => {
            println!(
                "cargo::warning=built without onnxruntime, so that the neural denoiser needs ORT_DYLIB_PATH: {reason}"
            );
            None
        }
    };
    let bytes = library.map(|path| format!("include_bytes!({path:?})"));
    writeln!(code, "/// onnxruntime as a shared library, where the build could get one.")?;
    let bytes = bytes.map_or("None".into(), |bytes| format!("Some({bytes})"));
    writeln!(code, "pub(super) const ONNXRUNTIME: Option<&[u8]> = {bytes};")?;

    writeln!(code, "/// The files of weights in `models`, by name.")?;
    writeln!(code, "pub(super) const MODELS: &[(&str, &[u8])] = &[")?;
    for path in weights()? {
        let name = path.file_name().unwrap_or_default();
        writeln!(code, "    ({name:?}, include_bytes!({path:?})),")?;
    }
    writeln!(code, "];")?;
    fs::write(out.join("embedded.rs"), code)?;
    Ok(())
}

/// The ONNX files beside `models.json` that it names.
fn weights() -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let folder = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("../models").canonicalize()?;
    println!("cargo::rerun-if-changed={}", folder.display());
    let list = fs::read_to_string(folder.join("models.json"))?;
    let mut paths = Vec::new();
    for entry in fs::read_dir(&folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.extension().is_some_and(|ending| ending == "onnx")
            && list.contains(&format!("{name:?}"))
        {
            println!("cargo::rerun-if-changed={}", path.display());
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// The folder of all that cargo builds, which it marks as a cache.
fn target_folder(out: &Path) -> PathBuf {
    let marked = out.ancestors().find(|folder| folder.join("CACHEDIR.TAG").exists());
    marked.unwrap_or(out).to_path_buf()
}

/// The library in `folder`, downloaded into it if need be.
fn onnxruntime(folder: &Path) -> Result<PathBuf, String> {
    let has = |name: &str, value: &str| env::var(name).is_ok_and(|found| found == value);
    if !(has("CARGO_CFG_TARGET_OS", "linux")
        && has("CARGO_CFG_TARGET_ARCH", "x86_64")
        && has("CARGO_CFG_TARGET_ENV", "gnu"))
    {
        return Err("no library is known for this platform".into());
    }
    for package in &PACKAGES {
        let path = folder.join(package.file);
        if package.is_whole(&path) {
            println!("cargo::rerun-if-changed={}", path.display());
            return Ok(path);
        }
    }
    let mut reasons = Vec::new();
    for package in &PACKAGES {
        // The name is this process's own: builds of two profiles may run at once.
        let work = folder.join(format!("download-{}", std::process::id()));
        let path = folder.join(package.file);
        match fetch(package, &work, &path) {
            Ok(()) => {
                println!("cargo::rerun-if-changed={}", path.display());
                return Ok(path);
            }
            Err(error) => reasons.push(error.to_string()),
        }
    }
    // A file that is not there makes cargo run this script at the next build.
    println!("cargo::rerun-if-changed={}", folder.join(PACKAGES[0].file).display());
    Err(reasons.join("; "))
}

/// Downloads a package into the folder `work`, which is removed afterwards, and puts its library at `path`.
fn fetch(package: &Package, work: &Path, path: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(work)?;
    let fetched = (package.fetch)(work).and_then(|library| {
        if !package.is_whole(&library) {
            return Err(format!("{} has not the SHA-256 expected", package.file).into());
        }
        Ok(fs::rename(library, path)?)
    });
    fs::remove_dir_all(work)?;
    fetched
}

impl Package {
    /// Whether the file is this package's library.
    fn is_whole(&self, path: &Path) -> bool {
        fs::read(path).is_ok_and(|bytes| sha256::sha256(&bytes) == self.sha256)
    }
}

fn fetch_from_pypi(folder: &Path) -> Result<PathBuf, Box<dyn Error>> {
    let requirements = folder.join("requirements.txt");
    fs::write(
        &requirements,
        "onnxruntime==1.28.0 --hash=sha256:a166b78ee04f3a37fa1ef82034b6a3ce96d9684e582d4d30b296de83e9998bb5\n",
    )?;
    let pip = |command: &mut Command| {
        command
            .args(["download", "--quiet", "--disable-pip-version-check"])
            .args(["--retries", "1", "--timeout", "20"])
            .args(["--no-deps", "--only-binary=:all:", "--require-hashes"])
            .args(["--implementation", "cp", "--python-version", "3.11", "--abi", "cp311"])
            .args(["--platform", "manylinux_2_28_x86_64", "--requirement"])
            .arg(&requirements)
            .arg("--dest")
            .arg(folder);
        run(command)
    };
    pip(Command::new("python3").args(["-m", "pip"]))
        .or_else(|_| pip(&mut Command::new("pip3")))
        .or_else(|_| pip(&mut Command::new("pip")))?;
    let wheel = with_ending(folder, "whl")?;
    let member = "onnxruntime/capi/libonnxruntime.so.1.28.0";
    run(Command::new("python3").args(["-m", "zipfile", "--extract"]).arg(&wheel).arg(folder))
        .or_else(|_| run(Command::new("unzip").arg("-q").arg(&wheel).arg("-d").arg(folder)))?;
    Ok(folder.join(member))
}

fn fetch_from_npm(folder: &Path) -> Result<PathBuf, Box<dyn Error>> {
    let member = "package/bin/napi-v6/linux/x64/libonnxruntime.so.1";
    run(Command::new("npm")
        .args(["pack", "--silent", "--fetch-retries=1", "onnxruntime-node@1.27.0"])
        .arg("--pack-destination")
        .arg(folder))?;
    let package = with_ending(folder, "tgz")?;
    run(Command::new("tar").arg("-xzf").arg(package).arg("-C").arg(folder).arg(member))?;
    Ok(folder.join(member))
}

/// Runs a command to its end; where it fails, the last line that it wrote is the reason.
fn run(command: &mut Command) -> Result<(), Box<dyn Error>> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| format!("{name}: {error}"))?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let last = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("no reason given");
    Err(format!("{name}: {last}").into())
}

/// The file of that ending in a folder.
fn with_ending(folder: &Path, ending: &str) -> Result<PathBuf, Box<dyn Error>> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|found| found == ending) {
            return Ok(path);
        }
    }
    Err(format!("the download has no .{ending} file in it").into())
}
