using System;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Text;
using UnityEngine;
using UnityEngine.Rendering;

namespace Lpvbake
{
    /// <summary>`lpvbake bake SCENE --at points.npy -o lit.npy`: light at points that an engine chose. Needs
    /// nothing of the engine but its vectors, and may run in any thread.</summary>
    public static class LpvbakeTool
    {
        public sealed class Lit
        {
            /// <summary>As Unity's light probes have it: summed over the basis of
            /// SphericalHarmonicsL2.Evaluate, it is irradiance over pi (lux), in Unity's axes.</summary>
            public SphericalHarmonicsL2[] light;
            /// <summary>Share of the directions in which a back is seen first; 1 inside geometry.</summary>
            public float[] backs;
        }

        /// <summary>Bakes at positions in Unity's axes, metres, of a scene whose glTF file was exported
        /// with x turned, as UnityGLTF and glTFast do. `options` go to lpvbake as they are. Throws
        /// InvalidOperationException with what lpvbake said, OperationCanceledException.</summary>
        public static Lit Bake(string program, string scene, string options, Vector3[] positions,
                               Func<bool> cancelled = null)
        {
            string folder = Path.Combine(Path.GetTempPath(), "lpvbake-" + Guid.NewGuid().ToString("N"));
            Directory.CreateDirectory(folder);
            try
            {
                string points = Path.Combine(folder, "points.npy"), lit = Path.Combine(folder, "lit.npy");
                Write(points, positions);
                Run(program, "bake " + Quoted(scene) + " --at " + Quoted(points) + " -o " + Quoted(lit) + " -q "
                    + options, cancelled);
                return Read(lit, positions.Length);
            }
            finally
            {
                Directory.Delete(folder, true);
            }
        }

        /// <summary>Canonical coefficient k of lpvbake (1, y, z, x, xy, yz, 3z2-1, xz, x2-y2; glTF's axes) to
        /// that of SphericalHarmonicsL2: cosine over pi times the basis' factor, and the sign of x.</summary>
        static readonly float[] factors =
        {
            0.28209479f, 0.32573501f, 0.32573501f, -0.32573501f,
            -0.27313711f, 0.27313711f, 0.07884789f, -0.27313711f, 0.13656855f
        };

        static string Quoted(string path)
        {
            if (path.IndexOf('"') >= 0)
                throw new ArgumentException(path + ": has a quotation mark; rename it");
            return '"' + path + '"';
        }

        static void Run(string program, string arguments, Func<bool> cancelled)
        {
            var start = new ProcessStartInfo(program, arguments)
            {
                UseShellExecute = false, CreateNoWindow = true, RedirectStandardError = true,
                RedirectStandardOutput = true
            };
            var said = new StringBuilder();
            using (Process process = Process.Start(start))
            {
                process.ErrorDataReceived += (_, line) => { lock (said) said.AppendLine(line.Data); };
                process.BeginErrorReadLine();
                process.OutputDataReceived += (_, line) => { };
                process.BeginOutputReadLine();
                while (!process.WaitForExit(50))
                    if (cancelled != null && cancelled())
                    {
                        process.Kill();
                        throw new OperationCanceledException("lpvbake was stopped");
                    }
                process.WaitForExit(); // for the rest of its output
                if (process.ExitCode != 0)
                    throw new InvalidOperationException(
                        "lpvbake ended with " + process.ExitCode.ToString(CultureInfo.InvariantCulture) + ": "
                        + said.ToString().Trim());
            }
        }

        /// <summary>An array of NumPy (format 1.0) of shape (n, 3), in glTF's axes.</summary>
        static void Write(string path, Vector3[] positions)
        {
            string header = "{'descr': '<f4', 'fortran_order': False, 'shape': ("
                            + positions.Length.ToString(CultureInfo.InvariantCulture) + ", 3), }";
            header = header.PadRight((10 + header.Length + 1 + 63) / 64 * 64 - 10 - 1) + "\n";
            using (var file = new BinaryWriter(File.Create(path)))
            {
                file.Write(new byte[] { 0x93, (byte)'N', (byte)'U', (byte)'M', (byte)'P', (byte)'Y', 1, 0 });
                file.Write((ushort)header.Length);
                file.Write(Encoding.ASCII.GetBytes(header));
                foreach (Vector3 position in positions)
                {
                    file.Write(-position.x);
                    file.Write(position.y);
                    file.Write(position.z);
                }
            }
        }

        /// <summary>Records of position (3 doubles), sh (3 floats a coefficient), validity, backs (a float
        /// each) and sky (4 floats).</summary>
        static Lit Read(string path, int count)
        {
            using (var file = new BinaryReader(File.OpenRead(path)))
            {
                file.ReadBytes(8);
                string header = Encoding.ASCII.GetString(file.ReadBytes(file.ReadUInt16()));
                const string before = "[('position', '<f8', (3,)), ('sh', '<f4', (";
                int at = header.IndexOf(before, StringComparison.Ordinal);
                int comma = at < 0 ? -1 : header.IndexOf(',', at + before.Length);
                if (comma < 0 || header.IndexOf("'shape': (" + count + ",)", StringComparison.Ordinal) < 0)
                    throw new InvalidOperationException(path + ": is not what this version of the bridge reads: " + header);
                int coefficients = int.Parse(header.Substring(at + before.Length, comma - at - before.Length),
                                             CultureInfo.InvariantCulture);
                var lit = new Lit { light = new SphericalHarmonicsL2[count], backs = new float[count] };
                for (int i = 0; i < count; ++i)
                {
                    file.ReadBytes(24);
                    for (int k = 0; k < coefficients; ++k)
                        for (int c = 0; c < 3; ++c)
                        {
                            float value = file.ReadSingle();
                            if (k < factors.Length)
                                lit.light[i][c, k] = factors[k] * value;
                        }
                    bool valid = file.ReadSingle() > 0;
                    float backs = file.ReadSingle();
                    lit.backs[i] = valid ? backs : 1;
                    file.ReadBytes(16);
                }
                return lit;
            }
        }
    }
}
