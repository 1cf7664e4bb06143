//! What a type of export is, whatever it makes: [`Export`], implemented by the options of each type in its own module
//! and listed in [`catalog`](super::catalog).

use std::io::Write;

use serde::Serialize;
use serde_json::Value;

use super::estimate::{Expected, ExportEstimate};
use super::materials::PhaseMaterial;
use super::{ExportError, Model};
use crate::checkpoint::Resume;
use crate::control::Control;
use crate::plan::Limits;
use crate::request::decode::Object;
use crate::request::{Materials, Specimen};

/// A type of export with its options: it makes one file of a packing.
pub trait Export: Serialize + Sized {
    /// The figures of the export, beside its file.
    type Report;

    /// Its name in requests and addresses.
    const NAME: &'static str;

    /// Names of its file formats, the default first.
    const FORMATS: &'static [&'static str];

    /// Reads the options, `format` among them; `None` means that faults were reported.
    fn from_object(object: &mut Object<'_>) -> Option<Self>;

    /// Name of the file format.
    fn format(&self) -> &'static str;

    /// Media type of the file, without parameters.
    fn media_type(&self) -> &'static str;

    /// Ending of the name of the file.
    fn file_extension(&self) -> &'static str {
        self.format()
    }

    /// What the name of the file says before the options that differ from the defaults.
    fn name_parts(&self) -> Vec<&'static str> {
        vec![Self::NAME]
    }

    /// The option that decides, beside the type, which defaults the others have.
    fn deciding_option(&self) -> (&'static str, &'static str) {
        ("format", self.format())
    }

    /// Whether an option differs from its default because another one does, so that a name need not tell it.
    fn is_implied(&self, _option: &str, _value: &Value) -> bool {
        false
    }

    /// The programs that the option `for` may name in a format; none where the format has no such option.
    fn programs(_format: &str) -> Vec<&'static str> {
        Vec::new()
    }

    /// The program that `for` must name in a format, where it is written for one program alone.
    fn needed_program(_format: &str) -> Option<&'static str> {
        None
    }

    /// Judges what can be judged before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Invalid`], [`ExportError::Unavailable`] or [`ExportError::TooLarge`].
    fn check(&self, _specimen: &Specimen, _limits: &Limits) -> Result<(), ExportError> {
        Ok(())
    }

    /// Says what the export is likely to come out as.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] where it cannot be made of such a specimen.
    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError>;

    /// Whether it takes less than a second for every packing.
    fn is_quick(&self) -> bool {
        false
    }

    /// Whether it needs [`Model::mesher`].
    fn needs_mesher(&self) -> bool {
        false
    }

    /// Whether it may take as long as a packing.
    fn is_heavy(&self, _specimen: &Specimen) -> bool {
        self.needs_mesher()
    }

    /// Whether it computes with materials, so that it needs some.
    fn needs_materials(&self) -> bool {
        false
    }

    /// The materials that its options name.
    fn materials(&self) -> Option<&Materials> {
        None
    }

    /// The place of its option `materials`, where the type has one.
    fn materials_mut(&mut self) -> Option<&mut Option<Materials>> {
        None
    }

    /// Judges the materials of the phases of a packing, where it computes with materials.
    ///
    /// # Errors
    /// [`ExportError::Invalid`] with every property that is missing.
    fn check_materials(&self, _phases: &[PhaseMaterial<'_>]) -> Result<(), ExportError> {
        Ok(())
    }

    /// Checks the report of a file that another process made; those that the server makes itself need no check.
    ///
    /// # Errors
    /// What cannot be, in one sentence.
    fn check_report(&self, _made: &Made<'_>, _report: &Self::Report) -> Result<(), String> {
        Ok(())
    }

    /// What a checkpoint of the export of a packing belongs to; none where it keeps no checkpoints.
    fn checkpoint_identity(&self, _model: &Model<'_>) -> Option<Vec<u8>> {
        None
    }

    /// Writes the file.
    ///
    /// # Errors
    /// See [`ExportError`].
    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<Self::Report, ExportError>;

    /// Writes the file, going on from a checkpoint of the same export where there is one: its bytes are the same.
    ///
    /// # Errors
    /// See [`ExportError`].
    fn write_or_resume(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        _resume: Option<Resume>,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<Self::Report, ExportError> {
        self.write(model, limits, control, out)
    }

    /// A second file that the program which reads the export needs beside it: the ending of its name, and its text.
    fn companion(&self, _file_name: &str) -> Option<(&'static str, String)> {
        None
    }
}

/// What writes a file of a packing of some kind: every [`Export`] of a [`Model`], and others of an
/// [`OwnPacking`](crate::OwnPacking).
pub trait Writes<P> {
    /// The figures of what is written.
    type Report;

    /// Writes the file.
    ///
    /// # Errors
    /// See [`ExportError`].
    fn write(
        &self,
        packing: &P,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<Self::Report, ExportError>;
}

impl<E: Export> Writes<Model<'_>> for E {
    type Report = E::Report;

    fn write(
        &self,
        packing: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<Self::Report, ExportError> {
        Export::write(self, packing, limits, control, out)
    }
}

/// What the report of a file that another process made is checked against.
#[derive(Clone, Copy, Debug)]
pub struct Made<'a> {
    /// The specimen of the packing.
    pub specimen: &'a Specimen,
    /// Volume fraction of the packing.
    pub volume_fraction: f64,
    /// The materials that the request of the packing states.
    pub materials: Option<&'a Materials>,
    /// Length of the file.
    pub bytes: u64,
}
