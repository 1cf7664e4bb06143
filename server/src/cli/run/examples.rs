//! The requests of the gallery, which the binary carries: `--example NAME` begins with a copy of one of them.

use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::super::exit::{Failure, cannot_be};

/// A request of the gallery.
#[derive(Clone, Copy, Debug)]
pub(super) struct Example {
    /// Name of its folder in `examples/gallery`.
    pub(super) name: &'static str,
    request: &'static str,
}

macro_rules! gallery {
    ($($name:literal,)+) => {
        const GALLERY: &[Example] = &[$(Example {
            name: $name,
            request: include_str!(concat!("../../../../examples/gallery/", $name, "/request.json")),
        }),+];
    };
}

gallery! {
    "air-voids",
    "astm-57",
    "calculix-deck",
    "category-fi35",
    "cement-and-water",
    "crushed-rock",
    "cylinder",
    "deformed-cuboids",
    "densest-packing",
    "dice",
    "flaky-gravel",
    "fuller-curve",
    "gap-by-size",
    "gap-for-meshing",
    "keep-what-fits",
    "lattice",
    "list-of-diameters",
    "lognormal",
    "lying-flat",
    "number-of-grains",
    "own-sieves",
    "periodic-cell",
    "prism",
    "random-addition",
    "recipe",
    "segregated",
    "slice",
    "standard-curve",
    "stiffness",
    "surface-mesh",
    "three-shapes",
    "voxels",
    "widest-gap",
}

impl Example {
    /// Writes the request into a folder, unless it lies there already, perhaps changed; returns its file.
    ///
    /// # Errors
    /// The folder or the file cannot be written.
    pub(super) fn copied_to(self, folder: &Path) -> Result<PathBuf, Failure> {
        std::fs::create_dir_all(folder).map_err(|error| cannot_be("made", folder, &error))?;
        let file = folder.join("request.json");
        if !file.exists() {
            std::fs::write(&file, self.request).map_err(|error| cannot_be("written", &file, &error))?;
        }
        Ok(file)
    }
}

/// Reads the name of an example.
pub(super) fn parser() -> impl TypedValueParser<Value = Example> {
    PossibleValuesParser::new(GALLERY.iter().map(|example| example.name))
        .try_map(|name| GALLERY.iter().copied().find(|example| example.name == name).ok_or("no such example"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_binary_carries_the_whole_gallery() {
        let gallery = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gallery");
        let mut folders: Vec<String> = std::fs::read_dir(gallery)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        folders.sort();
        assert_eq!(GALLERY.iter().map(|example| example.name.to_owned()).collect::<Vec<_>>(), folders);
    }

    #[test]
    fn a_request_that_was_changed_stays() {
        let folder = tempfile::tempdir().unwrap();
        let file = GALLERY[0].copied_to(folder.path()).unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), GALLERY[0].request);
        std::fs::write(&file, "{}").unwrap();
        assert_eq!(GALLERY[0].copied_to(folder.path()).unwrap(), file);
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "{}");
    }
}
