-- Owners: whose jobs and studies these are. So far the owner of a job was the key that submitted it; now several keys
-- may have one owner. A shared job or study can be read by others; the jobs of a shared study are shared too.

-- Name of the API key that submitted the job; empty where the server asked for none.
alter table jobs add column submitted_by text not null default '';
alter table jobs add column shared integer not null default 0;
alter table studies add column submitted_by text not null default '';
alter table studies add column owner text not null default '';
alter table studies add column shared integer not null default 0;

update jobs set submitted_by = owner where owner <> '';
-- All jobs of a study came with one key; a study without jobs is known by its idempotency key at most.
update studies set owner = coalesce(
    (select jobs.owner from jobs where jobs.study = studies.seq limit 1),
    (select study_keys.scope from study_keys where study_keys.study = studies.seq limit 1), ''
);
update studies set submitted_by = owner where owner <> '';

-- The listings of one owner walk this index, in the order of submission.
create index jobs_by_owner on jobs (owner, seq);
create index jobs_shared on jobs (seq) where shared;
