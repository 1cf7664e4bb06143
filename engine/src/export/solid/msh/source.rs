//! The numbers and lines of an MSH file, text or binary.

use std::io::{self, BufRead, BufReader, Read};

use super::MshError;

/// Longest line, and longest number, that is read, in bytes.
const MOST_BYTES: usize = 1 << 12;

/// A file that is read from its beginning to its end.
pub(super) struct Source<R> {
    input: BufReader<R>,
    /// Whether numbers are text.
    pub(super) is_text: bool,
    /// The section that is read, for messages.
    pub(super) section: String,
}

impl<R: Read> Source<R> {
    pub(super) fn new(input: R) -> Self {
        let input = BufReader::with_capacity(1 << 18, input);
        Self { input, is_text: true, section: "MeshFormat".into() }
    }

    /// A fault of the section that is read.
    pub(super) fn fault(&self, what: impl Into<String>) -> MshError {
        MshError::Damaged { section: self.section.clone(), what: what.into() }
    }

    /// The next line without the white space around it; `None` at the end of the file.
    pub(super) fn line(&mut self) -> Result<Option<String>, MshError> {
        let mut bytes = Vec::new();
        let read = (&mut self.input).take(MOST_BYTES as u64).read_until(b'\n', &mut bytes)?;
        if read == MOST_BYTES {
            return Err(self.fault("a line is too long"));
        }
        Ok((read > 0).then(|| String::from_utf8_lossy(&bytes).trim().to_owned()))
    }

    /// The next line that is not empty.
    pub(super) fn next_line(&mut self) -> Result<Option<String>, MshError> {
        loop {
            match self.line()? {
                Some(line) if line.is_empty() => {}
                other => return Ok(other),
            }
        }
    }

    /// Reads the line that ends the section.
    pub(super) fn end(&mut self) -> Result<(), MshError> {
        let expected = format!("$End{}", self.section);
        match self.next_line()? {
            Some(line) if line == expected => Ok(()),
            _ => Err(self.fault(format!("{expected} is missing"))),
        }
    }

    /// Passes over the rest of a section whatever it has.
    pub(super) fn skip(&mut self) -> Result<(), MshError> {
        let expected = format!("$End{}", self.section).into_bytes();
        let mut tail = Vec::new();
        loop {
            tail.clear();
            // Binary data may have no line for long: only the end of a piece can be the line that is looked for.
            let read = (&mut self.input).take(MOST_BYTES as u64).read_until(b'\n', &mut tail)?;
            if read == 0 {
                return Err(self.fault("its end is missing"));
            }
            if tail.trim_ascii().ends_with(&expected) {
                return Ok(());
            }
        }
    }

    fn token(&mut self) -> Result<String, MshError> {
        let mut token = String::new();
        loop {
            let bytes = self.input.fill_buf()?;
            let Some(&first) = bytes.first() else { break };
            if !first.is_ascii_whitespace() {
                if token.len() >= MOST_BYTES || !first.is_ascii_graphic() {
                    return Err(self.fault("a number is expected"));
                }
                token.push(first.into());
            } else if !token.is_empty() {
                break;
            }
            self.input.consume(1);
        }
        if token.is_empty() { Err(self.fault("the file ends within the section")) } else { Ok(token) }
    }

    fn parsed<T: std::str::FromStr>(&mut self) -> Result<T, MshError> {
        let token = self.token()?;
        token.parse().map_err(|_| self.fault(format!("{token:?} is not the number that is expected")))
    }

    pub(super) fn bytes<const N: usize>(&mut self) -> Result<[u8; N], MshError> {
        let mut bytes = [0; N];
        match self.input.read_exact(&mut bytes) {
            Ok(()) => Ok(bytes),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                Err(self.fault("the file ends within the section"))
            }
            Err(error) => Err(error.into()),
        }
    }

    pub(super) fn int(&mut self) -> Result<i32, MshError> {
        if self.is_text { self.parsed() } else { Ok(i32::from_le_bytes(self.bytes()?)) }
    }

    /// A count or the tag of a node or an element.
    pub(super) fn size(&mut self) -> Result<u64, MshError> {
        if self.is_text { self.parsed() } else { Ok(u64::from_le_bytes(self.bytes()?)) }
    }

    pub(super) fn double(&mut self) -> Result<f64, MshError> {
        if self.is_text { self.parsed() } else { Ok(f64::from_le_bytes(self.bytes()?)) }
    }
}
