//! Files that are named on the command line: worlds to read, and files to write.

use std::{
    fs::{self, File},
    io::{self, Read},
    path::Path,
};

use anyhow::{Context, bail};
use sightline_world::{World, is_world_file};

/// The endings of models that can be compiled.
const MODELS: [&str; 3] = ["glb", "gltf", "bsp"];

/// The bytes of a world file. A model in its place is named, with the command that compiles it.
///
/// # Errors
/// When the file cannot be read, or is no world.
pub fn world_bytes(path: &Path) -> anyhow::Result<Vec<u8>> {
    let cannot_read = || format!("cannot read {}", path.display());
    let mut file = File::open(path).with_context(cannot_read)?;
    let mut bytes = vec![0; 4];
    let begins = file.read(&mut bytes).with_context(cannot_read)?;
    bytes.truncate(begins);
    if !is_world_file(&bytes) {
        let is_model = path
            .extension()
            .is_some_and(|ending| MODELS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
            || bytes == b"glTF"
            || bytes == b"IBSP";
        let (path, compiled) = (path.display(), path.with_extension("slw"));
        if is_model {
            bail!(
                "{path} is a model, not a world: `sightline-server compile {path} -o {}` makes one",
                compiled.display()
            );
        }
        bail!("{path} is not a world (.slw): `sightline-server compile` makes one of a model");
    }
    file.read_to_end(&mut bytes).with_context(cannot_read)?;
    Ok(bytes)
}

/// Reads a world, as [`world_bytes`] does.
///
/// # Errors
/// When the file cannot be read, or is not a whole, valid world.
pub fn read_world(path: &Path) -> anyhow::Result<World> {
    World::from_bytes(&world_bytes(path)?).with_context(|| path.display().to_string())
}

/// Checks that a file can be written, before the work for it begins. Nothing is left behind.
///
/// # Errors
/// When it cannot.
pub fn check_output(path: &Path) -> anyhow::Result<()> {
    try_output(path).with_context(|| format!("cannot write {}", path.display()))
}

fn try_output(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(there) if there.is_dir() => Err(io::Error::other("it is a folder: name a file in it")),
        Ok(_) => fs::OpenOptions::new().append(true).open(path).map(drop),
        Err(_) => {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new("."));
            if !folder.is_dir() {
                let reason = format!("there is no folder {}: create it first", folder.display());
                return Err(io::Error::other(reason));
            }
            File::create_new(path)?;
            fs::remove_file(path)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::one_line;

    #[test]
    fn an_output_is_checked_and_nothing_is_left() {
        let folder = std::env::temp_dir().join(format!("sightline-out-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        check_output(&folder.join("new")).unwrap();
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 0);
        fs::write(folder.join("old"), "kept").unwrap();
        check_output(&folder.join("old")).unwrap();
        assert_eq!(fs::read_to_string(folder.join("old")).unwrap(), "kept");
        let error = |path: &Path| one_line(&check_output(path).unwrap_err());
        assert!(error(&folder).contains("it is a folder"));
        assert!(error(&folder.join("no/where")).contains("there is no folder"));
        check_output(Path::new("/dev/null")).unwrap();
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_model_in_place_of_a_world_is_named_with_the_command() {
        let folder = std::env::temp_dir().join(format!("sightline-in-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("house.glb");
        fs::write(&path, "glTF").unwrap();
        let error = one_line(&read_world(&path).unwrap_err());
        assert!(error.contains("compile") && error.contains("house.slw` makes one"), "{error}");
        fs::write(folder.join("text"), "no").unwrap();
        let error = one_line(&read_world(&folder.join("text")).unwrap_err());
        assert!(error.contains("is not a world"), "{error}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
