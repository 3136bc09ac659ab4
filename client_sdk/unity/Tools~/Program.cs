using System;
using System.Globalization;
using System.Runtime.InteropServices;
using System.Threading;

namespace Terraport.Tools
{
    /// <summary>
    /// Programs around the core that run without Unity: corpora, landings, decode speed, axes. The tests in tests/engines
    /// compile and run them.
    /// </summary>
    internal static class Program
    {
        private const string Usage = "usage: terraport-tools corpus wire|payload|session FOLDER\n"
            + "       terraport-tools land --scene URL [--NAME VALUE ...] STEP ...\n" + "       terraport-tools decode FILE [--seconds S]\n"
            + "       terraport-tools axes PAYLOAD ...\n";

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
            var rest = new string[Math.Max(arguments.Length - 1, 0)];
            Array.Copy(arguments, Math.Min(1, arguments.Length), rest, 0, rest.Length);
            switch (arguments.Length == 0 ? "" : arguments[0])
            {
                case "corpus":
                    if (rest.Length == 2 && rest[0] == "wire") return new WireCorpus(rest[1]).Run();
                    if (rest.Length == 2 && rest[0] == "payload") return new PayloadCorpus(rest[1]).Run();
                    if (rest.Length == 2 && rest[0] == "session") return new SessionCorpus(rest[1]).Run();
                    break;
                case "land": return Land.Run(rest);
                case "decode":
                    if (rest.Length == 1) return DecodeBenchmark.Run(rest[0], 2.0);
                    if (rest.Length == 3 && rest[1] == "--seconds") return DecodeBenchmark.Run(rest[0], double.Parse(rest[2]));
                    break;
                case "axes": return AxesDump.Run(rest);
            }
            Console.Error.Write(Usage);
            return 2;
        }
    }
}
