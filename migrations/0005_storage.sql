-- Storage: who submitted a job, what is stored by whom, files to be removed, and jobs that wait after a fault of the
-- machine.

-- A job or an export that met a fault of the machine starts no sooner than this, in microseconds since the Unix epoch.
alter table jobs add column not_before integer;
alter table exports add column not_before integer;
-- Faults of the machine since the last one that it did not meet; the pause grows with them.
alter table jobs add column faults integer not null default 0;
alter table exports add column faults integer not null default 0;

-- Name of the API key that submitted the job; empty where the server asks for none. Its files carry the name too, since
-- a file's row may be deleted after that of its job.
alter table jobs add column owner text not null default '';
alter table artifacts add column owner text not null default '';
alter table exports add column owner text not null default '';

-- Files that a committed deletion leaves behind. The sweeper removes these and no others: it moves what the database does
-- not know to the quarantine.
create table removals (
    path text primary key
) strict, without rowid;

create trigger removals_of_artifacts after delete on artifacts
begin
    insert or ignore into removals (path) values (old.path);
end;

create trigger removals_of_deleted_exports after delete on exports when old.path is not null
begin
    insert or ignore into removals (path) values (old.path);
end;

create trigger removals_of_requeued_exports after update of path on exports
when old.path is not null and new.path is not old.path
begin
    insert or ignore into removals (path) values (old.path);
end;

-- Bytes of files by the name of the key and what they are: quotas and metrics ask for it at every submission.
create table stored_bytes (
    owner text    not null,
    kind  text    not null check (kind in ('results', 'exports', 'cache')),
    bytes integer not null,
    primary key (owner, kind)
) strict, without rowid;

insert into stored_bytes (owner, kind, bytes)
select '', 'results', coalesce(sum(bytes), 0) from artifacts;
insert into stored_bytes (owner, kind, bytes)
select '', 'exports', coalesce(sum(bytes), 0) from exports where kept and path is not null;
insert into stored_bytes (owner, kind, bytes)
select '', 'cache', coalesce(sum(bytes), 0) from exports where not kept and path is not null;

create trigger stored_bytes_artifact_insert after insert on artifacts
begin
    insert into stored_bytes (owner, kind, bytes) values (new.owner, 'results', new.bytes)
    on conflict (owner, kind) do update set bytes = bytes + excluded.bytes;
end;

create trigger stored_bytes_artifact_delete after delete on artifacts
begin
    update stored_bytes set bytes = bytes - old.bytes where owner = old.owner and kind = 'results';
end;

create trigger stored_bytes_export_update after update of kept, path, bytes on exports
begin
    update stored_bytes set bytes = bytes - old.bytes
    where old.path is not null and owner = old.owner and kind = iif(old.kept, 'exports', 'cache');
    insert into stored_bytes (owner, kind, bytes)
    select new.owner, iif(new.kept, 'exports', 'cache'), new.bytes where new.path is not null
    on conflict (owner, kind) do update set bytes = bytes + excluded.bytes;
end;

create trigger stored_bytes_export_delete after delete on exports when old.path is not null
begin
    update stored_bytes set bytes = bytes - old.bytes
    where owner = old.owner and kind = iif(old.kept, 'exports', 'cache');
end;

-- Names of revision 1 in what was recorded of runs; requests and reports are renamed by the program.
update jobs set error = replace(replace(error, '/problems/packing-not-reached', '/problems/target-not-reached'),
    '"proven":', '"saturation_proven":')
where error like '%/problems/packing-not-reached%';
update jobs set progress = replace(replace(replace(progress,
    '"phase":"take"', '"phase":"sampling"'), '"phase":"verify"', '"phase":"check"'), '"phase":"derive"', '"phase":"export"')
where progress is not null;
