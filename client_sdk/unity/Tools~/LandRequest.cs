using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;

namespace Terraport.Tools
{
    /// <summary>What <c>land</c> was asked for, by its command line.</summary>
    internal sealed class LandRequest
    {
        public const string Usage = "usage: land --scene URL [--NAME VALUE ...] STEP ...\n"
            + "  --token T  --token-file PATH (read anew for each connection)  --max-triangles N  --max-bytes N  --max-segments N\n"
            + "  --cache-bytes N  --credit-bytes N  --disk FOLDER  --disk-bytes N\n"
            + "  --threaded 0|1  --timeout-s S  --dump FOLDER  --staged 0|1\n"
            + "steps: land:X,Y,Z,RADIUS[,INNER,DEADLINE_MS]  (until ready)    start:X,Y,Z,RADIUS  (until planned)\n"
            + "       wait  (until the newest landing is ready)    aim:X,Y,Z,RADIUS  (until prefetched)\n"
            + "       pick:X,Y,Z[,DX,DY,DZ]    pause:MS    reconnect[:TOKEN]\n"
            + "       join:NAME,guide|member[,OWN_NAME]  (until there is a seat)    people:N    leave    follow:0|1  (staged)\n"
            + "       gather:X,Y,Z,RADIUS  (until told)    barrier:N  (until the barrier of the group's landing N has opened)\n"
            + "       stand:X,Y,Z  (staged: the height of the ground that is shown there, and its segment)\n";

        private LandRequest()
        {
            Stream = new StreamOptions { Client = "terraport-land-csharp", Budgets = new Budgets() };
            TimeoutS = 60;
            Steps = new List<LandStep>();
        }

        public StreamOptions Stream { get; private set; }

        /// <summary>Whether the stream has a thread of its own, or is pumped by the program.</summary>
        public bool IsThreaded { get; private set; }

        /// <summary>Of the whole visit.</summary>
        public double TimeoutS { get; private set; }

        /// <summary>Where decoded normals and payloads are written; null for nowhere.</summary>
        public string DumpFolder { get; private set; }

        /// <summary>Whether the visit is staged, as in an engine.</summary>
        public bool IsStaged { get; private set; }

        public List<LandStep> Steps { get; private set; }

        /// <summary>Read the command line; null where it is wrong.</summary>
        public static LandRequest Parse(string[] arguments)
        {
            var request = new LandRequest();
            for (int at = 0; at < arguments.Length; at++)
            {
                string text = arguments[at];
                if (text.StartsWith("--", StringComparison.Ordinal))
                {
                    at++;
                    // Every option has a value: a flag without one is a mistake.
                    if (at == arguments.Length || !request.Set(text.Substring(2), arguments[at])) return null;
                }
                else
                {
                    LandStep step = LandStep.Parse(text);
                    if (step == null) return null;
                    request.Steps.Add(step);
                }
            }
            return request.Stream.SceneUrl == null || request.Steps.Count == 0 ? null : request;
        }

        private bool Set(string name, string value)
        {
            switch (name)
            {
                case "scene": Stream.SceneUrl = value; break;
                case "token": Stream.Token = value; break;
                case "token-file": Stream.TokenProvider = () => File.ReadAllText(value).Trim(); break;
                case "max-triangles": Stream.Budgets.MaxTriangles = Whole(value); break;
                case "max-bytes": Stream.Budgets.MaxBytes = Whole(value); break;
                case "max-segments": Stream.Budgets.MaxSegments = Whole(value); break;
                case "cache-bytes": Stream.CacheBytes = Whole(value); break;
                case "disk": Stream.DiskFolder = value; break;
                case "disk-bytes": Stream.DiskBytes = Whole(value); break;
                case "credit-bytes": Stream.CreditBytes = Whole(value); break;
                case "threaded": IsThreaded = value == "1"; break;
                case "timeout-s": TimeoutS = double.Parse(value, CultureInfo.InvariantCulture); break;
                case "dump": DumpFolder = value; break;
                case "staged": IsStaged = value == "1"; break;
                default: return false;
            }
            return true;
        }

        private static long Whole(string text) { return long.Parse(text, CultureInfo.InvariantCulture); }
    }
}
