//! The head of NumPy's format 1.0 (`numpy.lib.format` in NumPy's documentation). All arrays here are in column-major
//! order, in which the first index runs fastest.

/// What stands before the values of an array of a type in NumPy's notation.
pub(super) fn header(dtype: &str, shape: &[usize]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let mut text =
        format!("{{'descr': '{dtype}', 'fortran_order': True, 'shape': ({}), }}", shape.join(", "));
    // Magic, version and length take 10 bytes; the data start at a multiple of 64, after a newline.
    let padded = (10 + text.len() + 1).next_multiple_of(64) - 10;
    text.extend(std::iter::repeat_n(' ', padded - 1 - text.len()));
    text.push('\n');
    [b"\x93NUMPY\x01\x00", &(padded as u16).to_le_bytes()[..], text.as_bytes()].concat()
}
