-- Exports: the table `derived` under the name that the interface uses. The rows stay as they are.

drop trigger derived_counts_insert;
drop trigger derived_counts_update;
drop trigger derived_counts_delete;
drop index derived_by_key;
drop index derived_by_job;
drop index derived_queue;
drop index derived_quick;
drop index derived_running;
drop index derived_cache;

alter table derived rename to exports;
alter table derived_counts rename to export_counts;
alter table export_counts rename column derived to exports;

create unique index exports_by_key on exports (job, key);
create index exports_by_job on exports (job, seq);
-- The next export to run is the first entry of this index.
create index exports_queue on exports (rank, seq) where state = 'queued';
create index exports_quick on exports (rank, seq) where state = 'queued' and quick;
create index exports_running on exports (seq) where state = 'running';
create index exports_cache on exports (used_at) where not kept and path is not null;

create trigger export_counts_insert after insert on exports
begin
    update export_counts set exports = exports + 1 where state = new.state;
end;

create trigger export_counts_update after update of state, kept, path on exports
begin
    update export_counts set exports = exports - 1, cache_bytes = cache_bytes - iif(old.kept, 0, coalesce(old.bytes, 0))
    where state = old.state;
    update export_counts set exports = exports + 1, cache_bytes = cache_bytes + iif(new.kept, 0, coalesce(new.bytes, 0))
    where state = new.state;
end;

create trigger export_counts_delete after delete on exports
begin
    update export_counts set exports = exports - 1, cache_bytes = cache_bytes - iif(old.kept, 0, coalesce(old.bytes, 0))
    where state = old.state;
end;
