//! The databases that the store can lie in: SQLite and PostgreSQL.
//!
//! The store has one text of SQL. Both databases know most of it; where they differ, a query has two texts
//! ([`either()`]). A text marks its parameters as SQLite does, `?` in their order or `?1` by number. This module binds
//! values ([`Value`]), runs the text in the database at hand, and reads the rows ([`Row`]).

mod bind;
mod builder;
mod connection;
pub(super) mod postgres;
mod row;
mod statement;
mod transaction;

pub(super) use bind::Value;
pub(super) use builder::QueryBuilder;
pub(super) use connection::{
    Connection, Durability, Options, Readers, Via, WAIT_FOR_HELD_LOCK, WAIT_FOR_LOCK,
};
pub(super) use row::Row;
pub(super) use statement::{Source, Text, either, query};
pub(super) use transaction::Transaction;
