//! Which toolchain compiles for WebAssembly: the one in use, or Debian's.

use std::{
    ffi::OsString,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, bail, ensure};

const TARGET: &str = "wasm32-unknown-unknown";
/// Where Debian's rust-web-src puts the source of the standard library.
const DEBIAN_LIBRARY: &str = "/usr/lib/rustlib/src/rust/library";
const DEBIAN_TOOLS: &str = "/usr/bin";

/// A toolchain that compiles for WebAssembly.
pub(super) enum Compiler {
    /// The one in use, with the target's standard library.
    Own,
    /// Debian's rustc-web and cargo-web. It compiles the standard library, too.
    Debian,
}

impl Compiler {
    /// The one that this machine has.
    pub(super) fn find() -> anyhow::Result<Self> {
        let library = output("rustc", &["--print", "target-libdir", "--target", TARGET])?;
        if Path::new(&library).is_dir() {
            return Ok(Self::Own);
        }
        if Path::new(DEBIAN_LIBRARY).is_dir() && Path::new(DEBIAN_TOOLS).join("cargo").exists() {
            return Ok(Self::Debian);
        }
        bail!(
            "no toolchain compiles for WebAssembly: run `rustup target add {TARGET}`, or install \
             Debian's rustc-web, cargo-web and rust-web-src"
        )
    }

    /// Compiles the client. Returns the path of the program.
    pub(super) fn build(&self, root: &Path, simd: bool) -> anyhow::Result<PathBuf> {
        // A folder of its own: this may be another compiler.
        let target = root.join("target/web");
        let mut flags = vec![format!("--remap-path-prefix={}=cargo", cargo_home()?.display())];
        if simd {
            flags.push("-Ctarget-feature=+simd128".to_owned());
        }
        let mut cargo = match self {
            Self::Own => Command::new("cargo"),
            Self::Debian => {
                let tools = Path::new(DEBIAN_TOOLS);
                let mut cargo = Command::new(tools.join("cargo"));
                cargo.env("RUSTC", tools.join("rustc")).env("RUSTC_BOOTSTRAP", "1");
                cargo.args(["-Zbuild-std=std,panic_abort", "-Zbuild-std-features="]);
                flags.extend(linker()?.map(|path| format!("-Clinker={}", path.display())));
                cargo
            }
        };
        cargo
            .current_dir(root)
            .args(["build", "--locked", "--profile", "web", "-p", "sightline-web"])
            .args(["--target", TARGET])
            .env("CARGO_TARGET_DIR", &target)
            .env("CARGO_ENCODED_RUSTFLAGS", flags.join("\u{1f}"))
            // What cargo tells its own programs is about the compiler that runs this one.
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("RUSTFLAGS");
        ensure!(cargo.status()?.success(), "the client does not compile for WebAssembly");
        Ok(target.join(TARGET).join("web/sightline_web.wasm"))
    }
}

/// The linker that comes with the toolchain in use, for one that has none.
fn linker() -> anyhow::Result<Option<PathBuf>> {
    let library = output("rustc", &["--print", "target-libdir"])?;
    let linker = Path::new(&library).parent().map(|host| host.join("bin/rust-lld"));
    Ok(linker.filter(|linker| linker.exists()))
}

fn cargo_home() -> anyhow::Result<PathBuf> {
    let own = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = || std::env::var_os("HOME").map(|home: OsString| Path::new(&home).join(".cargo"));
    own.or_else(home).context("neither CARGO_HOME nor HOME is set")
}

/// What a program prints.
fn output(program: &str, args: &[&str]) -> anyhow::Result<String> {
    let output = Command::new(program).args(args).output();
    let output = output.with_context(|| format!("cannot run {program}"))?;
    ensure!(output.status.success(), "{program} {args:?} fails");
    Ok(String::from_utf8(output.stdout)?.trim().to_owned())
}
