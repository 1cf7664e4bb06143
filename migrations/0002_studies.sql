-- Studies: many jobs from one request, what became of their runs, and turns in the queue.

-- Counts follow the jobs by trigger; a job that is deleted stays counted, as its run stays in the table.
create table studies (
    seq         integer primary key autoincrement,
    id          text    not null unique,
    name        text,
    labels      text    not null,
    seed        integer not null,
    -- JSON pointers that distinguish the points; empty for a list of jobs.
    columns     text    not null,
    -- Names of the first columns of the table.
    key_columns text    not null,
    points      integer not null,
    replicates  integer not null,
    stop_when   text    not null,
    queued      integer not null,
    running     integer not null default 0,
    succeeded   integer not null default 0,
    failed      integer not null default 0,
    cancelled   integer not null default 0,
    -- Runs that say something about their mix, and the time they took: what is left is judged by it.
    runs        integer not null default 0,
    runs_time_s real    not null default 0,
    -- Counts the changes a client can see; the ETag of the study.
    version     integer not null default 1,
    created_at  integer not null,
    -- When no job was left to run; empty again after a retry.
    finished_at integer,
    updated_at  integer not null,
    expires_at  integer
) strict;

create index studies_open on studies (seq) where finished_at is null;
create index studies_finished on studies (seq) where finished_at is not null;
create index studies_expiry on studies (expires_at) where expires_at is not null;

create table study_requests (
    study integer primary key references studies (seq) on delete cascade,
    body  text    not null
) strict;

create table study_labels (
    key   text    not null,
    value text    not null,
    study integer not null references studies (seq) on delete cascade,
    primary key (key, value, study)
) strict, without rowid;

create index study_labels_by_study on study_labels (study);

create table study_points (
    study         integer not null references studies (seq) on delete cascade,
    point         integer not null,
    -- Values of the table's first columns.
    key_values    text    not null,
    -- Jobs that the stop rule has called off.
    stopped_early integer not null default 0,
    primary key (study, point)
) strict, without rowid;

-- One row for every job of a study that has run or was cancelled by a client; it outlives the job. Together with the
-- points it is all that the table needs.
create table study_runs (
    study     integer not null references studies (seq) on delete cascade,
    point     integer not null,
    replicate integer not null,
    outcome   text    not null check (outcome in ('succeeded', 'not_reached', 'void')),
    facts     text    not null,
    ended_at  integer not null,
    primary key (study, point, replicate)
) strict, without rowid;

create table study_keys (
    scope       text    not null,
    key         text    not null,
    body_sha256 text    not null,
    study       integer not null references studies (seq) on delete cascade,
    primary key (scope, key)
) strict, without rowid;

create index study_keys_by_study on study_keys (study);

alter table jobs add column study integer references studies (seq) on delete cascade;
alter table jobs add column point integer;
alter table jobs add column replicate integer;
-- Place in the queue among jobs of its priority.
alter table jobs add column turn integer not null default 0;

create index jobs_by_study on jobs (study, seq) where study is not null;
create index jobs_by_study_state on jobs (study, state, seq) where study is not null;
create unique index jobs_by_point on jobs (study, point, replicate) where study is not null;

drop index jobs_queue;
create index jobs_queue on jobs (priority desc, turn, seq) where state = 'queued';

-- Start-time fair queueing, apart for each priority: the turn of the job that started last, and the last turn of
-- every flow. A flow is a study; flow 0 is all single jobs.
create table queue_times (
    priority integer primary key,
    turn     integer not null
) strict;

create table queue_flows (
    flow      integer not null,
    priority  integer not null,
    last_turn integer not null,
    primary key (flow, priority)
) strict, without rowid;

create trigger queue_flows_end after delete on studies
begin
    delete from queue_flows where flow = old.seq;
end;

-- What waits already takes turns in its order, so that a study does not wait for all of it.
update jobs set turn = ranked.turn
from (
    select seq, row_number() over (partition by priority order by seq) as turn from jobs where state = 'queued'
) as ranked
where jobs.seq = ranked.seq;

insert into queue_flows (flow, priority, last_turn)
select 0, priority, max(turn) from jobs where state = 'queued' group by priority;

create trigger study_counts_update after update of state on jobs
when new.study is not null and new.state <> old.state
begin
    update studies set
        queued = queued + (new.state = 'queued') - (old.state = 'queued'),
        running = running + (new.state = 'running') - (old.state = 'running'),
        succeeded = succeeded + (new.state = 'succeeded') - (old.state = 'succeeded'),
        failed = failed + (new.state = 'failed') - (old.state = 'failed'),
        cancelled = cancelled + (new.state = 'cancelled') - (old.state = 'cancelled'),
        finished_at = iif(
            queued + running + (new.state in ('queued', 'running')) - (old.state in ('queued', 'running')) = 0,
            new.updated_at, null
        ),
        version = version + 1,
        updated_at = new.updated_at
    where seq = new.study;
end;

-- An end that says nothing about the mix. Who knows that it does says so in the same transaction. Clients' wishes to
-- cancel are marked in the job; what is cancelled without one was called off by the stop rule, and has not run.
create trigger study_runs_void after update of state on jobs
when new.study is not null and old.state in ('queued', 'running')
    and (new.state = 'failed' or (new.state = 'cancelled' and new.cancel_requested))
begin
    insert or replace into study_runs (study, point, replicate, outcome, facts, ended_at)
    values (
        new.study, new.point, new.replicate, 'void',
        json_object('time_s', (new.finished_at - coalesce(new.started_at, new.finished_at)) / 1e6), new.finished_at
    );
end;

create trigger study_points_stopped after update of state on jobs
when new.study is not null and old.state = 'queued' and new.state = 'cancelled' and not new.cancel_requested
begin
    update study_points set stopped_early = stopped_early + 1 where study = new.study and point = new.point;
end;

-- What is tried again has not run.
create trigger study_runs_retried after update of state on jobs
when new.study is not null and new.state = 'queued' and old.state in ('failed', 'cancelled')
begin
    delete from study_runs where study = new.study and point = new.point and replicate = new.replicate;
    update study_points set stopped_early = stopped_early - 1
    where study = new.study and point = new.point and old.state = 'cancelled' and not old.cancel_requested;
end;
