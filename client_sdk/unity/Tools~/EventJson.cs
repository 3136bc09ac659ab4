using System.Collections.Generic;

namespace Terraport.Tools
{
    /// <summary>Events and counts of a stream as JSON, in the words of tests/engines/README.md.</summary>
    internal static class EventJson
    {
        public static void Describe(JsonText json, StreamEvent told)
        {
            json.Open('{').Key("type").Value(Name(told.Kind)).Key("landing");
            if (told.Landing.HasValue)
                json.Value((long)told.Landing.Value);
            else
                json.Null();
            switch (told.Kind)
            {
                case StreamEventKind.Link: DescribeLink(json, told.Link); break;
                case StreamEventKind.Opened:
                    json.Key("scene_version").Value(told.SceneVersion).Key("session").Value(told.Session);
                    json.Key("changed").Value(told.IsChanged).Key("held_count").Value((long)told.HeldCount);
                    break;
                case StreamEventKind.Planned: DescribePlan(json, told.Plan); break;
                case StreamEventKind.Arrived:
                    json.Key("facts");
                    DescribeFacts(json, told.Facts);
                    break;
                case StreamEventKind.Degraded:
                case StreamEventKind.Dropped: json.Key("segments").Values(told.Segments); break;
                case StreamEventKind.Ready:
                    json.Key("visible").Values(told.Segments).Key("missing").Values(told.Missing);
                    json.Key("elapsed_ms").Value(told.ElapsedMs).Key("payload_bytes").Value(told.Bytes);
                    break;
                case StreamEventKind.Superseded: json.Key("by").Value((long)told.By); break;
                case StreamEventKind.Prefetching:
                case StreamEventKind.Prefetched: json.Key("segments").Value((long)told.Count).Key("bytes").Value(told.Bytes); break;
                case StreamEventKind.Refused:
                    json.Key("code").Value(told.Code).Key("message").Value(told.Message).Key("fatal").Value(told.IsFatal);
                    break;
                case StreamEventKind.Notice: json.Key("kind").Value(told.Notice); break;
                case StreamEventKind.Picked:
                    json.Key("request").Value((long)told.Request);
                    DescribeHit(json, told.Hit);
                    break;
                case StreamEventKind.PickRefused: json.Key("request").Value((long)told.Request).Key("code").Value(told.Code); break;
            }
            json.Close('}');
        }

        public static void Describe(JsonText json, StreamStats stats)
        {
            json.Open('{').Key("payload_bytes").Value(stats.PayloadBytes).Key("repeated_bytes").Value(stats.RepeatedBytes);
            json.Key("held_segments").Value((long)stats.HeldSegments).Key("held_bytes").Value(stats.HeldBytes);
            json.Key("aimed_landings").Value((long)stats.AimedLandings).Key("aim_hits").Value((long)stats.AimHits);
            json.Key("prefetched_bytes").Value(stats.PrefetchedBytes);
            json.Key("used_prefetched_bytes").Value(stats.UsedPrefetchedBytes).Close('}');
        }

        private static string Name(StreamEventKind kind)
        {
            return kind == StreamEventKind.PickRefused ? "pick_refused" : kind.ToString().ToLowerInvariant();
        }

        private static void DescribeLink(JsonText json, LinkState link)
        {
            json.Key("state").Value(link.Phase.ToString().ToLowerInvariant());
            json.Key("attempt").Value((long)link.Attempt).Key("retry_in_ms").Value(link.RetryInMs);
            json.Key("close_code").Value((long)link.CloseCode).Key("code").Value(link.Code ?? "");
            json.Key("message").Value(link.Message ?? "");
        }

        private static void DescribeFacts(JsonText json, SegmentFacts facts)
        {
            json.Open('{').Key("id").Value((long)facts.Segment).Key("length").Value((long)facts.Length);
            json.Key("xxh3").Value(facts.Xxh3.ToString("x16"));
            json.Key("faces").Value((long)facts.Faces).Key("vertices").Value((long)facts.Vertices);
            Box box = facts.Bounds;
            json.Key("bounds").Values(new[] { box.MinX, box.MinY, box.MinZ, box.MaxX, box.MaxY, box.MaxZ }, 6).Close('}');
        }

        private static void DescribePlan(JsonText json, PlanFacts plan)
        {
            DescribePlace(json, plan.Position);
            json.Key("radius_m").Value(plan.RadiusM).Key("effective_radius_m").Value(plan.EffectiveRadiusM);
            json.Key("load").Open('[');
            foreach (SegmentFacts facts in plan.Load) DescribeFacts(json, facts);
            json.Close(']').Key("keep").Values(plan.Keep).Key("nearby").Values(plan.Nearby);
            json.Key("load_bytes").Value(plan.LoadBytes).Key("total_bytes").Value(plan.TotalBytes);
            json.Key("total_triangles").Value(plan.TotalTriangles).Key("omitted_segments").Value(plan.OmittedSegments);
            json.Key("omitted_by").Value(plan.OmittedBy);
        }

        private static void DescribeHit(JsonText json, PickHit hit)
        {
            json.Key("hit");
            if (hit == null)
            {
                json.Null();
                return;
            }
            json.Open('{');
            DescribePlace(json, hit.Position);
            json.Key("segment").Value((long)hit.Segment).Key("region").Value((long)hit.Region).Key("height_m").Value(hit.HeightM);
            json.Key("attributes").Open('{');
            foreach (KeyValuePair<string, double> attribute in hit.Attributes) json.Key(attribute.Key).Value(attribute.Value);
            json.Close('}').Close('}');
        }

        private static void DescribePlace(JsonText json, Vec3 place)
        {
            json.Key("position").Open('[').Value(place.X).Value(place.Y).Value(place.Z).Close(']');
        }
    }
}
