-- Webhooks: where to send a message when a job ends or a study finishes, and what became of each message.

-- The job or the study that names the URL. Requests and results do not contain the URL, because it may contain a token.
create table webhooks (
    seq   integer primary key,
    job   integer unique references jobs (seq) on delete cascade,
    study integer unique references studies (seq) on delete cascade,
    url   text    not null,
    -- Host of the URL: one message at a time is sent to it.
    host  text    not null,
    check ((job is null) <> (study is null))
) strict;

create table webhook_deliveries (
    seq          integer primary key autoincrement,
    webhook      integer not null references webhooks (seq) on delete cascade,
    -- The header `webhook-id`: the same in all attempts, so that a receiver can drop repeats.
    id           text    not null unique,
    body         text    not null,
    host         text    not null,
    state        text    not null check (state in ('waiting', 'delivered', 'failed')),
    attempts     integer not null default 0,
    sent_before  integer not null generated always as (attempts > 0),
    -- The next attempt is not made before this time.
    next_at      integer not null,
    -- The last attempt: what was wrong, and the HTTP status where there was an answer.
    last_error   text,
    last_status  integer,
    created_at   integer not null,
    delivered_at integer
) strict;

-- The next message of a host is the first entry of the host in this index.
create index webhook_deliveries_waiting on webhook_deliveries (host, sent_before, next_at, seq) where state = 'waiting';
create index webhook_deliveries_by_webhook on webhook_deliveries (webhook, seq);

-- The end of a job records its message in the same transaction, whatever statement ends it. The jobs of a study have no
-- webhook.
create trigger webhook_of_job after update of state on jobs
when new.state in ('succeeded', 'failed', 'cancelled') and old.state in ('queued', 'running') and new.study is null
begin
    insert into webhook_deliveries (webhook, id, body, host, state, next_at, created_at)
    select
        webhooks.seq,
        'msg_' || lower(hex(randomblob(16))),
        json_object(
            'type', 'job.' || new.state,
            'timestamp', strftime('%Y-%m-%dT%H:%M:%S', new.finished_at / 1000000, 'unixepoch')
                || printf('.%06dZ', new.finished_at % 1000000),
            'data', json_patch(
                json_object(
                    'id', new.id, 'name', new.name, 'labels', json(new.labels), 'state', new.state,
                    'links', json_object('self', '/v1/jobs/' || new.id)
                ),
                iif(
                    new.state = 'failed',
                    json_object(
                        'error', json_object('code', new.error ->> '$.code', 'detail', new.error ->> '$.detail')
                    ),
                    '{}'
                )
            )
        ),
        webhooks.host, 'waiting', new.finished_at, new.finished_at
    from webhooks where webhooks.job = new.seq;
end;

create trigger webhook_of_study after update of finished_at on studies
when new.finished_at is not null and old.finished_at is null
begin
    insert into webhook_deliveries (webhook, id, body, host, state, next_at, created_at)
    select
        webhooks.seq,
        'msg_' || lower(hex(randomblob(16))),
        json_object(
            'type', 'study.finished',
            'timestamp', strftime('%Y-%m-%dT%H:%M:%S', new.finished_at / 1000000, 'unixepoch')
                || printf('.%06dZ', new.finished_at % 1000000),
            'data', json_object(
                'id', new.id, 'name', new.name, 'labels', json(new.labels), 'state', 'finished',
                'counts', json_object(
                    'succeeded', new.succeeded, 'failed', new.failed, 'cancelled', new.cancelled
                ),
                'links', json_object('self', '/v1/studies/' || new.id)
            )
        ),
        webhooks.host, 'waiting', new.finished_at, new.finished_at
    from webhooks where webhooks.study = new.seq;
end;
