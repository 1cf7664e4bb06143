-- The URL of a webhook may be changed: a message is sent to the URL that the webhook had when it was recorded. A webhook
-- that was removed has an empty URL, and its messages stay.
alter table webhook_deliveries add column url text not null default '';

update webhook_deliveries set url = (select webhooks.url from webhooks where webhooks.seq = webhook_deliveries.webhook);

drop trigger webhook_of_job;
drop trigger webhook_of_study;

-- The end of a job records its message in the same transaction, whatever statement ends it. The jobs of a study have no
-- webhook.
create trigger webhook_of_job after update of state on jobs
when new.state in ('succeeded', 'failed', 'cancelled') and old.state in ('queued', 'running') and new.study is null
begin
    insert into webhook_deliveries (webhook, id, body, url, host, state, next_at, created_at)
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
        webhooks.url, webhooks.host, 'waiting', new.finished_at, new.finished_at
    from webhooks where webhooks.job = new.seq and webhooks.url <> '';
end;

create trigger webhook_of_study after update of finished_at on studies
when new.finished_at is not null and old.finished_at is null
begin
    insert into webhook_deliveries (webhook, id, body, url, host, state, next_at, created_at)
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
        webhooks.url, webhooks.host, 'waiting', new.finished_at, new.finished_at
    from webhooks where webhooks.study = new.seq and webhooks.url <> '';
end;
