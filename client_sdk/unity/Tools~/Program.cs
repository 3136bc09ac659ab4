using System;
using System.Globalization;
using System.Linq;
using System.Runtime.InteropServices;
using System.Threading;

namespace Terraport.Tools
{
    /// <summary>Programs around the core that run without Unity. The tests in tests/engines compile and run them.</summary>
    internal static class Program
    {
        private const string Usage = "usage: terraport-tools corpus messages|payload|landings FOLDER\n"
            + "       terraport-tools axes PAYLOAD ...\n       terraport-tools regions REGIONS LABELS REGION\n       terraport-tools "
            + "decode SECONDS ATTRIBUTES PAYLOAD ...\n" + Visit.Usage;

        private static int Main(string[] arguments)
        {
            int code = Run(arguments);
            Console.Out.Flush();
            // Mono 6.8 ends by aborting its own timers' thread, now and then in the middle of a sort, with exit code 134.
            EndProcess(code);
            return code;
        }

        [DllImport("libc", EntryPoint = "_exit")]
        private static extern void EndProcess(int code);

        private static int Run(string[] arguments)
        {
            Thread.CurrentThread.CurrentCulture = CultureInfo.InvariantCulture;
            string[] rest = arguments.Skip(1).ToArray();
            switch (arguments.FirstOrDefault())
            {
                case "corpus": return Corpora.Run(rest[0], rest[1]);
                case "land": return Visit.Run(rest);
                case "axes": return AxesDump.Run(rest);
                case "regions": return RegionsDump.Run(rest[0], rest[1], int.Parse(rest[2]));
                case "decode": return DecodeBenchmark.Run(double.Parse(rest[0]), int.Parse(rest[1]), rest.Skip(2).ToArray());
            }
            Console.Error.Write(Usage);
            return 2;
        }
    }
}
